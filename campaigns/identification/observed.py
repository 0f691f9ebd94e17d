"""Observations of a campaign: rows of files and objects of campaign.yaml as blocks for the fit.

Rows of one kind and object are one `Measured`; those that are held out are another. Where a file
marks none as held out, a share of each can be: every so many rows in the order of the file, so that
they lie all over what was measured, as a touched bed does.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import OptionsInvalid
from campaigns.fit.kinds import KINDS
from campaigns.identification.objects import Object, linked
from campaigns.identification.other_kinds import Measured
from campaigns.settings.sections import ObjectConfig
from campaigns.shots.observations_csv import ObservationRow
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots_csv import times_s


def objects_of(configs: Sequence[ObjectConfig]) -> tuple[Object, ...]:
    """Return the objects of campaign.yaml, each with what it stands on."""
    return tuple(linked(Object(**config.model_dump()) for config in configs).values())


def measured_of(rows: Sequence[ObservationRow], objects: Sequence[Object]) -> tuple[Measured, ...]:
    """Return rows of any kinds and objects as blocks, in the order of their first rows.

    Raise `OptionsInvalid` for an object that is not among the objects.
    """
    of_name = {thing.name: thing for thing in objects}
    groups: dict[tuple[str, str, bool], list[int]] = {}
    for place, row in enumerate(rows):
        if row.object not in of_name:
            raise OptionsInvalid(
                f"'{row.object}' was measured, which is not among the objects of campaign.yaml",
                remedy=f"write `- {{name: {row.object}}}` under objects in campaign.yaml",
            )
        key = (row.kind, row.object, row.purpose is ShotSet.VALIDATION)
        groups.setdefault(key, []).append(place)
    seconds, _ = times_s([row.time or "" for row in rows])
    return tuple(
        Measured(
            kind=kind,
            object=of_name[name],
            joints=_joints_of([rows[place] for place in places]),
            values=np.array([rows[place].values for place in places]),
            std_mm=np.array([[rows[place].std_mm] * KINDS[kind].width for place in places]),
            held_out=is_held_out,
            moment=None if seconds is None else seconds[places],
            session=_sessions_of([rows[place] for place in places]),
            labels=tuple(rows[place].place or str(number) for number, place in enumerate(places)),
        )
        for (kind, name, is_held_out), places in groups.items()
    )


def hold_out(
    rows: Sequence[ObservationRow], share: float, rng: np.random.Generator
) -> tuple[ObservationRow, ...]:
    """Return the rows with a share of each kind and object held out, spread over their order.

    Kinds and objects of which the file marks rows as held out stay as they are, and so do single
    rows.
    """
    groups: dict[tuple[str, str], list[int]] = {}
    for place, row in enumerate(rows):
        groups.setdefault((row.kind, row.object), []).append(place)
    changed = [*rows]
    for places in groups.values():
        is_marked = any(rows[place].purpose is ShotSet.VALIDATION for place in places)
        count = round(share * len(places))
        if is_marked or not count:
            continue
        step = len(places) / count
        for number in (step * (np.arange(count) + rng.uniform())).astype(int).tolist():
            changed[places[number]] = replace(rows[places[number]], purpose=ShotSet.VALIDATION)
    return tuple(changed)


def _joints_of(rows: Sequence[ObservationRow]) -> Array:
    """Return joints (M, n) of observations of one pose, (M, 2, n) of two."""
    joints = np.array([row.joints for row in rows])
    return np.asarray(joints[:, 0] if joints.shape[1] == 1 else joints)


def _sessions_of(rows: Sequence[ObservationRow]) -> Array | None:
    """Return the tracker's station of each row, (M,); None if no row states one."""
    sessions = np.array([row.session for row in rows])
    return sessions if sessions.any() else None
