"""Planning of observations of other kinds: which, where, and what further ones would gain."""

# 1. Draw candidates for each object of campaign.yaml, and for the shots if there is a tracker.
# 2. The outlook: shots of the plan have the weight 1, shots of a reflector elsewhere on the
#    platform are observations of the object that carries it.
# 3. Add the best observations of each object that some are asked for, in the order of the options;
#    a fifth as many again are held out, drawn at random, so that something tests the result.
# 4. State what all of this will determine, and compare ten more of each object.

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.campaign import Campaign
from campaigns.design.tours import shortest_tour
from campaigns.errors import OptionsInvalid, PlanInvalid
from campaigns.fit.error_model import ErrorModel, Observations
from campaigns.fit.kinds import KINDS
from campaigns.identification.determined import Determined
from campaigns.identification.observed import objects_of
from campaigns.identification.options import QuantityWord
from campaigns.identification.other_kinds import Measured, other_kinds
from campaigns.kinematics.transmission import approach_along
from campaigns.planning.forecast import points_of
from campaigns.planning.optimal_plan import candidates
from campaigns.planning.plan_check import REFLECTOR_MOVE_S
from campaigns.planning.plan_file import PlannedShot, move_aside
from campaigns.planning.plans import joints_of, pairs_of, poses_of
from campaigns.settings.instrument import StatedInstrument
from campaigns.shots.observations_csv import DEFAULT, FILE_NAME, ObservationRow, write_observations
from campaigns.shots.shot_sets import ShotSet
from campaigns.studies.observation_candidates import (
    USUAL,
    WITHOUT_LENGTH,
    ObservedCell,
    WantedObservations,
    candidates_of,
    kind_of,
    read_wish,
)
from campaigns.studies.outlook import (
    SHOTS,
    Gain,
    Outlook,
    judged_in_space,
    outlook,
    planned_points,
    without_tracker,
)

FURTHER = 10
"""Number of further observations of each object by which kinds are compared."""
PER_HELD_OUT = 5
"""Observations to fit for each one that is held out."""
CANDIDATE_SHOTS = 300
"""Shots of which the ten best are compared with observations of other kinds."""


@dataclass(frozen=True, slots=True)
class PlannedObservations:
    """Planned observations of other kinds, and what all that is planned will determine."""

    rows: tuple[ObservationRow, ...]
    """In the order in which they are measured; they have no values yet."""
    seconds: float
    """Time that they take, estimated."""
    determined: tuple[Determined, ...]
    """By shots and observations together."""
    quantity: QuantityWord
    """What observations were chosen for, and are compared by."""
    gains: tuple[Gain, ...]
    """What ten more of each object, and ten more shots, would gain; the most per minute first."""
    has_lengths: bool
    """Whether anything planned has a length, by which the size of a robot is determined."""
    path: Path | None
    """Where the rows are written; None: there are none."""
    older: Path | None = None
    """Path under which the file before is kept; None without one."""


@dataclass(frozen=True, slots=True, eq=False)
class _Drawn:
    """Candidates of one object, after those that shots of the plan are already."""

    wish: WantedObservations
    measured: Measured
    planned: int


def plan_observations(
    campaign: Campaign,
    wishes: Sequence[str],
    quantity: QuantityWord,
    model: ErrorModel,
    rng: np.random.Generator,
    shots: tuple[Sequence[PlannedShot], float] | None = None,
) -> tuple[PlannedObservations, Outlook]:
    """Plan the observations that are wished for, beside shots with their time or alone.

    Nothing is written. Raise `OptionsInvalid` for wishes or a quantity that nothing observes,
    `PlanInvalid` for an object out of reach.
    """
    planned, seconds_each = shots or ((), 0.0)
    cell = ObservedCell(
        robot=campaign.robot_model,
        region=campaign.region if planned else None,
        instrument=campaign.instrument,
        measuring_s=seconds_each,
    )
    model = model if planned else without_tracker(model)
    points, count = _points(campaign, model, planned, rng)
    drawn = _draw(_wishes(campaign, wishes), cell, planned, rng)
    expected = _outlook(campaign, model, (points, count), [of.measured for of in drawn])
    for number, of_object in enumerate(drawn, start=1):
        expected = expected.with_rows(number, np.arange(of_object.planned))
    if quantity not in expected.judged:
        raise OptionsInvalid(
            f"--for {quantity}: nothing observes it",
            remedy=f"take {', '.join(expected.judged)}, or list a bed under objects in "
            "campaign.yaml",
        )
    chosen: list[ObservationRow] = []
    for number, of_object in enumerate(drawn, start=1):
        if of_object.wish.count:
            expected, rows = _choose(campaign, expected, number, of_object, quantity, rng)
            chosen += rows
    tested = _tested(campaign, planned, chosen)
    expected = replace(expected, tested=tested).judged_where_planned()
    numbers = range(SHOTS if planned else SHOTS + 1, len(drawn) + 1)
    gains = [_gain(expected, number, quantity, cell) for number in numbers]
    kinds = {row.kind for row in chosen} | ({"reflector"} if planned else set())
    observations = PlannedObservations(
        rows=tuple(chosen),
        seconds=sum(cell.seconds(row.kind) for row in chosen),
        determined=expected.determined,
        quantity=quantity,
        gains=tuple(sorted(gains, key=lambda gain: -gain.share / max(gain.seconds, 1.0))),
        has_lengths=not kinds <= WITHOUT_LENGTH,
        path=campaign.path(FILE_NAME) if chosen else None,
    )
    return observations, expected


def write_planned(campaign: Campaign, observations: PlannedObservations) -> PlannedObservations:
    """Write observations.csv without values; an older one is kept as `observations-older-N.csv`.

    Return the observations with the older file's path. Raise `WriteFailed`. The caller holds the
    campaign.
    """
    if observations.path is None:
        return observations
    older = move_aside(observations.path)
    write_observations(observations.path, observations.rows, campaign.robot.mechanism)
    return replace(observations, older=older)


def _wishes(campaign: Campaign, texts: Sequence[str]) -> list[WantedObservations]:
    """Return what is wished for, then all other objects of which a kind is stated, to compare.

    Raise `OptionsInvalid` for a wish that is unclear, or stands twice.
    """
    objects = {thing.name: thing for thing in objects_of(campaign.config.objects)}
    wishes: dict[str, WantedObservations] = {}
    for text in texts:
        wish = read_wish(text, objects)
        if wishes.setdefault(wish.thing.name, wish) is not wish:
            raise OptionsInvalid(
                f"--observe {wish.thing.name} stands twice", remedy="give one number for each"
            )
    for name in [name for name in objects if name not in wishes]:
        with suppress(OptionsInvalid):
            wishes[name] = WantedObservations(objects[name], kind_of(objects[name]), 0)
    return [*wishes.values()]


def _draw(
    wishes: Sequence[WantedObservations],
    cell: ObservedCell,
    shots: Sequence[PlannedShot],
    rng: np.random.Generator,
) -> list[_Drawn]:
    """Return candidates of each object, without those that are only compared and have no poses."""
    drawn = []
    for wish in wishes:
        try:
            measured = candidates_of(wish, cell, rng)
        except PlanInvalid:
            if wish.count:
                raise
            continue
        carried = _carried(shots, wish.thing.name)
        drawn.append(_Drawn(wish, _joined(measured, carried, cell), len(carried)))
    return drawn


def _choose(
    campaign: Campaign,
    expected: Outlook,
    number: int,
    drawn: _Drawn,
    quantity: QuantityWord,
    rng: np.random.Generator,
) -> tuple[Outlook, list[ObservationRow]]:
    """Return the outlook with the best observations of an object, and their rows."""
    before, count = expected.chosen(number), drawn.wish.count
    expected = expected.with_best(number, count, quantity)
    chosen = np.setdiff1d(expected.chosen(number), before)
    free = np.setdiff1d(np.arange(len(drawn.measured.values)), expected.chosen(number))
    held_out = rng.permutation(free)[: math.ceil(count / PER_HELD_OUT)]
    return expected, _rows_of(campaign, drawn.measured, chosen, held_out)


def _points(
    campaign: Campaign, model: ErrorModel, shots: Sequence[PlannedShot], rng: np.random.Generator
) -> tuple[Observations, int]:
    """Return the points of planned shots and of candidates, and how many are planned."""
    mechanism = campaign.robot.mechanism
    joints, poses = np.zeros((0, len(mechanism.joints))), np.zeros((0, len(mechanism.task)))
    approach, count = joints, 0
    if shots:
        rows = points_of(shots)
        further = candidates(campaign.region, CANDIDATE_SHOTS, rng)
        at_further = campaign.robot.kinematics.inverse(further).values_or_raise()
        joints = np.vstack([joints_of(shots)[rows], at_further])
        poses = np.vstack([poses_of(shots)[rows], further])
        sides = approach_along(joints_of(shots))[rows]
        approach, count = np.vstack([sides, np.zeros_like(at_further)]), len(rows)
    tracker_mm = np.array(campaign.view.tracker_mm)
    return planned_points(model, joints, poses, approach, tracker_mm, campaign.instrument), count


def _carried(shots: Sequence[PlannedShot], name: str) -> list[PlannedShot]:
    """Return the planned shots to identify from of a reflector at an object."""
    whole = pairs_of(shots, ShotSet.IDENTIFICATION).ravel().tolist()
    return [shots[row] for row in whole if shots[row].reflector == name]


def _joined(drawn: Measured, shots: Sequence[PlannedShot], cell: ObservedCell) -> Measured:
    """Return candidates after the planned shots of a reflector that the object carries."""
    if not shots or cell.region is None:
        return drawn
    seen = poses_of(shots)[:, :3] - cell.region.view_from_mm
    joints = joints_of(shots).reshape(-1, *drawn.joints.shape[1:])
    return replace(
        drawn,
        joints=np.concatenate([joints, drawn.joints]),
        values=np.concatenate([seen, np.asarray(drawn.values)]),
    )


def _outlook(
    campaign: Campaign,
    model: ErrorModel,
    points: tuple[Observations, int],
    measured: Sequence[Measured],
) -> Outlook:
    """Return the outlook of planned and further shots, with nothing else planned."""
    kinematics, sample = campaign.robot.kinematics, campaign.workspace_sample()
    if sample is None:
        raise PlanInvalid(
            "the robot can take hardly a pose of its workspace",
            remedy="correct its geometry and limits in robot.yaml",
        )
    solved = kinematics.inverse(sample)
    judged = judged_in_space(model, solved.values[solved.is_solved], sample[solved.is_solved])
    shots, count = points
    kinds = other_kinds(measured, model.nominal, shots if count else None)
    return outlook(model, shots, count, kinds, judged)


def _tested(
    campaign: Campaign, shots: Sequence[PlannedShot], rows: Sequence[ObservationRow]
) -> frozenset[str]:
    """Return the quantities that planned hold-out shots and observations will check."""
    reflectors = {shot.reflector for shot in shots if shot.purpose is ShotSet.VALIDATION}
    tested: set[str] = {"position", "flat", "xy"} if reflectors else set()
    carriers = [thing for thing in objects_of(campaign.config.objects) if thing.name in reflectors]
    if {thing.part for thing in carriers} & {*campaign.robot.mechanism.halves}:
        tested.add("rotation")  # as `tested_by`: both parts are seen
    held_out = (row for row in rows if row.purpose is ShotSet.VALIDATION)
    return frozenset(tested.union(*(KINDS[row.kind].checks for row in held_out)))


def _gain(expected: Outlook, number: int, quantity: QuantityWord, cell: ObservedCell) -> Gain:
    """Return what ten more of an object would gain, and the time that they take."""
    gain = expected.gain(number, FURTHER, quantity)
    seconds = gain.count * cell.seconds(gain.kind)
    if gain.kind == "reflector" and not expected.count(number):
        seconds += REFLECTOR_MOVE_S  # it is not there yet
    return replace(gain, seconds=seconds)


def _rows_of(
    campaign: Campaign, measured: Measured, chosen: Index, held_out: Index
) -> list[ObservationRow]:
    """Return the rows of chosen and held-out observations, ordered for little travel."""
    kinematics = campaign.robot.kinematics
    joints = measured.joints.reshape(len(measured.values), -1, measured.joints.shape[-1])
    rows = np.concatenate([chosen, held_out])
    start = kinematics.inverse(campaign.centre[None]).values_or_raise()[0]
    ordered = _tour(kinematics.comparable(joints[rows]), kinematics.comparable(start))
    std_mm, std_source = float(np.max(np.asarray(measured.std_mm))), DEFAULT
    limits = StatedInstrument.of(campaign.config.tracker).of_shot
    if measured.kind not in USUAL and limits.source == "data sheet":
        std_source = limits.source_in_words
    is_pair = joints.shape[1] > 1
    return [
        ObservationRow(
            kind=measured.kind,
            object=measured.object.name,
            joints=tuple(tuple(pose) for pose in joints[rows[place]].tolist()),
            values=(),
            std_mm=round(std_mm, 6),
            std_source=std_source,
            purpose=ShotSet.VALIDATION if place >= len(chosen) else ShotSet.IDENTIFICATION,
            pair=str(number) if is_pair else "",
        )
        for number, place in enumerate(ordered.tolist(), start=1)
    ]


def _tour(joints: Array, start: Array) -> Index:
    """Return the order of observations (M, b, n) in which the joints travel little."""
    count, bodies = joints.shape[:2]
    ends = bodies * np.arange(count)[:, None] + [0, bodies - 1]
    tour = shortest_tour(joints.reshape(count * bodies, -1), ends, start)
    return np.asarray(tour[:, 0] // bodies, dtype=np.intp)
