"""History of a robot: what the journals of its campaigns hold of parameters, errors and checks."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import datetime
from itertools import pairwise

import numpy as np

from campaigns.arrays import AXES
from campaigns.campaign import Campaign
from campaigns.errors import OptionsInvalid, ShotsMissing
from campaigns.estimation.information import SIGNIFICANCE, WorkspaceSample, chance_of_change
from campaigns.evaluation.base_motion import BaseMotion, base_motion
from campaigns.evaluation.calibration_check import RecordedCheck, read_check
from campaigns.evaluation.decision import COVERAGE
from campaigns.evaluation.trend import Epoch, NextCheck, ParameterTrend, next_check, trends
from campaigns.evidence import evaluate
from campaigns.identification.checking import BY_ONE
from campaigns.identification.result import RecordedIdentification, read_identification
from campaigns.journal.records import Finding
from campaigns.journal.views import Series
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.parameters import Parameters

SAME = 1e-9
"""Difference of held parameters, mm and deg, that is rounding."""


@dataclass(frozen=True, slots=True)
class BaseSince:
    """What base and robot did since an older campaign, the base by nests that both measured."""

    folder: str
    since: str
    base: BaseMotion
    robot_p: float | None
    """Chance of an unchanged robot to show the parameters' changes; None: they were not told."""

    @property
    def says(self) -> str:
        """Sentence on both."""
        changed = self.robot_p is not None and self.robot_p < SIGNIFICANCE
        robot = "the robot changed" if changed else "the robot did not change beyond chance"
        also = "; by that its base frame may have moved, not its base" if changed else ""
        robot = "whether the robot changed is not known" if self.robot_p is None else robot
        both = changed and self.base.decision == "fail"
        return f"{self.folder} since {self.since}: {self.base.says}; {robot}{also if both else ''}"


@dataclass(frozen=True, slots=True)
class History:
    """History of one robot: epochs in the order of time, trends, and the next check."""

    epochs: tuple[Epoch, ...]
    trends: tuple[ParameterTrend, ...]
    due: NextCheck
    bases: tuple[BaseSince, ...] = ()
    """By nests: what base and robot did from each campaign to the next."""
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
    names, sample = [each.name for each in found if each.drifts], None
    poses = campaign.workspace_sample() if names else None
    if poses is not None:
        robot = Kinematics.of(mechanism, latest.flat())
        sample = WorkspaceSample.of_workspace(robot, names, poses)
    limit_mm = campaign.config.acceptance.distance_mean_mm
    due = next_check(epochs, found, sample, limit_mm, now)
    return History(epochs, found, due, (*_bases(campaigns),), (*_notes(epochs),))


def _bases(campaigns: Sequence[Campaign]) -> Iterator[BaseSince]:
    """What base and robot did since the campaign before, of those whose nests have equal names.

    By the latest identification of each that passed and was no repair.
    """
    every = list[tuple[str, Campaign, RecordedIdentification]]()
    for campaign in campaigns:
        with campaign.journal_reader() as journal:
            records = [each.record for each in journal.records_of(Finding)]
            series = {each.number: each for each in journal.series()}
        sets = [read_identification(e.body) for e in records if e.kind == "identification"]
        good = [each for each in sets if each.verdict == "pass" and each.pedigree is None]
        for found in good[-1:]:
            at_utc = _measured_utc(series.get(found.series), found.at_utc)
            every.append((at_utc, campaign, found))
    every.sort(key=lambda each: datetime.fromisoformat(each[0]))
    for (_, before, older), (_, after, newer) in pairwise(every):
        places, seen = older.nest_places(), newer.nest_places()
        if places is None or seen is None or not _same_datum(older, newer):
            continue
        if base := base_motion(places, seen, before.centre[: len(AXES)]):
            yield BaseSince(str(after.folder), str(before.folder), base, _robot_p(older, newer))


def _same_datum(older: RecordedIdentification, newer: RecordedIdentification) -> bool:
    """Whether all that neither looked for, and so the base frame's datum, has the same values."""
    held = set(older.flat()) - {*older.free, *newer.free}
    ours, theirs = older.flat(), newer.flat()
    return all(abs(ours[name] - theirs.get(name, 0.0)) <= SAME for name in held)


def _robot_p(older: RecordedIdentification, newer: RecordedIdentification) -> float | None:
    """Chance of an unchanged robot to show as large changes of all that both tell."""
    if older.covariance is None or newer.covariance is None:
        return None
    both, common = (older.covariance, newer.covariance), {*newer.covariance.names}
    names = tuple(name for name in older.covariance.names if name in common)
    if not names or set(older.free) != set(newer.free):
        return None
    known = sum((each.only(names).total_array for each in both), np.zeros((len(names),) * 2))
    moved = np.array([newer.flat()[name] - older.flat()[name] for name in names])
    return chance_of_change(moved, known)


def _read(campaign: Campaign) -> tuple[tuple[Epoch, ...], RecordedIdentification]:
    """Epochs of a campaign and its latest identification; raises `ShotsMissing`.

    Of each series the latest identification counts; a check that was repaired is in the repair.
    """
    sets: dict[tuple[int, ...], RecordedIdentification] = {}
    checks: dict[int, RecordedCheck] = {}
    flats: dict[str, dict[str, float]] = {}
    with campaign.journal_reader() as journal:
        series = {each.number: each for each in journal.series()}
        for entry in journal.records_of(Finding):
            body = entry.record.body
            if entry.record.kind == "identification":
                found = read_identification(body)
                sets[found.pedigree.series if found.pedigree else (found.series,)] = found
                flats[_digest(campaign, found)] = found.flat()
            elif entry.record.kind == "check":
                check = read_check(body)
                checks[check.series] = check
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
    for number, check in checks.items():
        stored = {} if number in repaired else flats.get(check.of, {})
        epochs.append(_of_check(campaign, check, stored, series.get(number)))
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
    campaign: Campaign, check: RecordedCheck, stored: dict[str, float], series: Series | None
) -> Epoch:
    """Epoch of a check: each part had it alone changed where it is good, else the one it names."""
    named = check.changed if len(check.changed) == 1 and not check.as_likely else ()
    parts = check.parts if check.decision == "pass" else named
    own = [each for each in parts if each.kind in BY_ONE and each.name in stored]
    return Epoch(
        folder=str(campaign.folder),
        kind="check",
        measured_utc=_measured_utc(series, check.at_utc),
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
    free = {frozenset(each.std) for each in epochs if each.kind == "campaign" and each.std}
    if len(free) > 1:
        yield "the campaigns looked for different parameters: changes may come of that"
