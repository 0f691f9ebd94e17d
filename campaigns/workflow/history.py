"""History of a robot: what the journals of its campaigns hold of parameters, errors and checks."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

import numpy as np
from pydantic import TypeAdapter

from campaigns.campaign import Campaign
from campaigns.errors import OptionsInvalid, ShotsMissing
from campaigns.estimation.information import WorkspaceSample
from campaigns.evaluation.calibration_check import CalibrationCheck
from campaigns.evaluation.decision import COVERAGE
from campaigns.evaluation.trend import Epoch, NextCheck, ParameterTrend, next_check, trends
from campaigns.evidence import evaluate
from campaigns.identification.checking import BY_ONE
from campaigns.identification.result import RecordedIdentification, read_identification
from campaigns.journal.records import Finding
from campaigns.journal.views import Series
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.parameters import Parameters


@dataclass(frozen=True, slots=True)
class History:
    """History of one robot: epochs in the order of time, trends, and the next check."""

    epochs: tuple[Epoch, ...]
    trends: tuple[ParameterTrend, ...]
    due: NextCheck
    notes: tuple[str, ...] = ()


def history(campaigns: Sequence[Campaign], now: datetime) -> History:
    """History over campaigns of one robot.

    Raises `OptionsInvalid` for different robots or a folder named twice, and `ShotsMissing`.
    """
    read = [_read(campaign) for campaign in campaigns]
    _require_one_robot(campaigns)
    epochs = tuple(sorted((each for own, _ in read for each in own), key=lambda each: each.at))
    latest, campaign = max(
        ((found, campaign) for (_, found), campaign in zip(read, campaigns, strict=True)),
        key=lambda each: datetime.fromisoformat(each[0].at_utc),
    )
    mechanism = campaign.robot.mechanism
    units = {name: mechanism.parameters[name].unit for name in mechanism.parameters.names}
    found = trends(epochs, units)
    names, sample, points = [each.name for each in found if each.drifts], None, np.empty((0, 3))
    poses = campaign.workspace_sample() if names else None
    if poses is not None:
        robot = Kinematics.of(mechanism, latest.flat())
        sample, points = WorkspaceSample.of(robot, names, poses), poses[:, :3]
    limit_mm = campaign.config.acceptance.distance_mean_mm
    due = next_check(epochs, found, sample, points, limit_mm, now)
    return History(epochs, found, due, (*_notes(epochs),))


def _read(campaign: Campaign) -> tuple[tuple[Epoch, ...], RecordedIdentification]:
    """Epochs of a campaign and its latest identification; raises `ShotsMissing`.

    Of each series the latest identification counts; a check that was repaired is in the repair.
    """
    sets: dict[tuple[int, ...], RecordedIdentification] = {}
    checks: dict[int, tuple[dict[str, Any], CalibrationCheck]] = {}
    flats: dict[str, dict[str, float]] = {}
    with campaign.journal_reader() as journal:
        series = {each.number: each for each in journal.series()}
        for entry in journal.records_of(Finding):
            body: dict[str, Any] = dict(entry.record.body)
            if entry.record.kind == "identification":
                found = read_identification(body)
                sets[found.pedigree.series if found.pedigree else (found.series,)] = found
                flats[_digest(campaign, found)] = found.flat()
            elif entry.record.kind == "check":
                checks[body["series"]] = body, TypeAdapter(CalibrationCheck).validate_python(body)
    if not sets:
        raise ShotsMissing(
            f"{campaign.folder}: nothing has been identified yet",
            remedy=f"`pkmcal identify {campaign.folder}`, or leave it out",
        )
    evaluation = evaluate(campaign)
    stages = (evaluation.before, evaluation.after)
    before, after = (each.distances.mean if each and each.distances else None for each in stages)
    held, epochs = evaluation.evidence.held("after"), list[Epoch]()
    for numbers, found in sets.items():
        own = _of_set(campaign, found, series.get(numbers[-1]))
        origin = held.origin if held else ""
        epochs.append(replace(own, after=after if origin == _digest(campaign, found) else None))
    epochs[0] = replace(epochs[0], before=before)
    repaired = {number for numbers in sets for number in numbers[:-1]}
    for number, (body, check) in checks.items():
        stored = {} if number in repaired else flats.get(body["of"], {})
        epochs.append(_of_check(campaign, body, check, stored, series.get(number)))
    return tuple(epochs), max(sets.values(), key=lambda each: datetime.fromisoformat(each.at_utc))


def _digest(campaign: Campaign, found: RecordedIdentification) -> str:
    return Parameters.of(campaign.robot.mechanism.parameters, found.flat()).digest()


def _measured_utc(series: Series | None, at_utc: str) -> str:
    """When the last shot was measured; of what the journal lacks, when it was judged."""
    return max((each.measured_utc for each in series.shots), default=at_utc) if series else at_utc


def _of_set(campaign: Campaign, found: RecordedIdentification, series: Series | None) -> Epoch:
    """Epoch of an identification or a repair, without values where it did not pass."""
    good, positions = found.verdict == "pass", found.position_std_mm
    total = {name: each.total_std for name, each in found.parameters.items()}
    std = {name: total[name] or each for name, each in found.std().items() if each > 0.0}
    changed = found.pedigree.changed if found.pedigree else ()
    reasons = "; ".join(() if good else found.reasons)
    return Epoch(
        folder=str(campaign.folder),
        kind="repair" if found.pedigree else "campaign",
        measured_utc=_measured_utc(series, found.at_utc),
        decision=found.verdict,
        says=f"found anew: {', '.join(changed)}" if changed else reasons,
        values={name: found.flat()[name] for name in std} if good else {},
        std=std if good else {},
        position_std_mm=(positions.total_mean or positions.mean) if positions else None,
        unseen_mm=found.unseen_mm.after.mean_abs if found.unseen_mm and not changed else None,
    )


def _of_check(
    campaign: Campaign,
    body: dict[str, Any],
    check: CalibrationCheck,
    stored: dict[str, float],
    series: Series | None,
) -> Epoch:
    """Epoch of a check: each part had it alone changed where it is good, else the one it names."""
    named = check.changed if len(check.changed) == 1 and not check.as_likely else ()
    parts = check.parts if check.decision == "pass" else named
    own = [each for each in parts if each.kind in BY_ONE and each.name in stored]
    return Epoch(
        folder=str(campaign.folder),
        kind="check",
        measured_utc=_measured_utc(series, body["at_utc"]),
        decision=check.decision,
        says=check.says,
        values={each.name: stored[each.name] + each.size for each in own},
        std={each.name: each.expanded_uncertainty / COVERAGE for each in own},
    )


def _require_one_robot(campaigns: Sequence[Campaign]) -> None:
    """Raise `OptionsInvalid` unless mechanism and serial number are the same, as far as known."""
    first, *others = campaigns
    if len({each.folder.resolve() for each in campaigns}) < len(campaigns):
        raise OptionsInvalid("DIR is named twice", remedy="name each campaign once")
    for other in others:
        for what, ours, theirs in _identities(first, other):
            if ours and theirs and ours != theirs:
                raise OptionsInvalid(
                    f"{other.folder} is of another robot than {first.folder}: {what} '{theirs}', "
                    f"not '{ours}'",
                    remedy="name campaigns of one robot",
                )


def _identities(first: Campaign, other: Campaign) -> Iterator[tuple[str, str, str]]:
    """What must be the same of two campaigns; a robot's serial number outranks its controller's."""
    yield "mechanism", first.robot.mechanism.name, other.robot.mechanism.name
    ours, theirs = (each.config.instruments.robot_serial for each in (first, other))
    yield "serial number", ours, theirs
    if not (ours and theirs):
        yield "controller's serial number", _controller(first), _controller(other)


def _controller(campaign: Campaign) -> str:
    with campaign.journal_reader() as journal:
        known = [each.started.robot for each in journal.series() if each.started.robot]
    return known[-1].serial if known else ""


def _notes(epochs: Sequence[Epoch]) -> Iterator[str]:
    """What makes changes doubtful: other parameters held, which take a part in all others."""
    free = {frozenset(each.std) for each in epochs if each.kind != "check" and each.std}
    if len(free) > 1:
        yield "the campaigns looked for different parameters: changes may come of that"
