"""History of a robot: parameters, errors and checks from the journals of its campaigns."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import datetime
from itertools import combinations
from pathlib import Path
from typing import Literal, TypeVar

from pydantic import JsonValue

from campaigns.assessment import Evaluation, evaluate
from campaigns.campaign import Campaign, CampaignFolder, open_campaign, open_folder
from campaigns.errors import FindingUnreadable, OptionsInvalid, ShotsMissing
from campaigns.evaluation.decision import Decision
from campaigns.identification.checking import read_check
from campaigns.identification.result import RecordedIdentification, read_identification
from campaigns.journal.records import Finding
from campaigns.journal.views import Entry, Series
from campaigns.robots.program import ProgramUntrusted
from drivers.texts import quoted

ResultT = TypeVar("ResultT")
UNREAD = "without figures of the robot: its program is not trusted (`pkmcal trust`)"
OLDER_MODEL = "by an older model: figures are not comparable"


@dataclass(frozen=True, slots=True)
class ParameterError:
    """Error of a parameter at a time: identified minus nominal value."""

    name: str
    measured_utc: str
    """Time of the last shot that it was identified from."""
    delta: float
    """Identified minus nominal value, in `unit`."""
    std: float
    """1 σ of `delta`, in `unit`."""
    unit: str
    by_older_model: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Epoch:
    """Identification or check of a robot, as a row of its history."""

    folder: str
    kind: Literal["campaign", "check"]
    measured_utc: str
    """Time of its last shot."""
    decision: Decision | None
    """None for a finding of an older version that is left out."""
    says: str
    """Reasons against an identification, or the result of a check, in words."""
    by_older_model: bool = False
    """Whether an older version identified it: its figures are not comparable with others."""
    note: str = ""
    """Why figures are not comparable or left out, and what renews them; empty if they are."""
    parameters: tuple[ParameterError, ...] = field(default=(), repr=False)
    """Errors of the free parameters; empty unless an identification passed."""
    before_mm: float | None = None
    """Mean error of distances as commanded before calibration, mm; None: not measured."""
    after_mm: float | None = None
    """Mean error of distances as commanded with these parameters, mm; None: not measured."""
    unseen_mm: float | None = None
    """Mean error of distances of hold-out pairs by the model, mm; None: there were none."""


def readable_campaign(folder: Path) -> CampaignFolder:
    """Open a campaign, without its robot if the robot's program may not run; raise as those do."""
    try:
        return open_campaign(folder)
    except ProgramUntrusted:
        return open_folder(folder)


def history(campaigns: Sequence[CampaignFolder]) -> tuple[Epoch, ...]:
    """Collect the identifications and checks of one robot's campaigns in the order of time.

    Raise `OptionsInvalid` for different robots or a folder that is named twice, and `ShotsMissing`
    for a campaign without an identification.
    """
    epochs = [epoch for campaign in campaigns for epoch in _epochs(campaign)]
    _require_one_robot(campaigns)
    return tuple(sorted(epochs, key=lambda epoch: datetime.fromisoformat(epoch.measured_utc)))


def _epochs(campaign: CampaignFolder) -> Iterator[Epoch]:
    """Yield a campaign's latest identification of each series, and its checks.

    A campaign without its robot, whose program may not run, has their times and decisions alone.
    """
    with campaign.journal_reader() as journal:
        series = {each.number: each for each in journal.series()}
        of_identifications = journal.findings("identification")
        of_checks = journal.findings("check")
    # a series that was identified several times is one state of the robot: its last result counts
    results = _readable(of_identifications, read_identification)
    identifications = {result.provenance.series: result for result in results}
    # `identify` takes the latest series: earlier ones cannot be renewed
    latest = max((number for number, each in series.items() if each.to_identify), default=None)
    left_out = [
        entry
        for entry in _unreadable(of_identifications, read_identification)
        if entry.record.body.get("series") not in identifications
    ]
    if not (identifications or left_out):
        raise ShotsMissing(
            f"{campaign.folder}: nothing has been identified yet",
            remedy="`pkmcal identify DIR`, or leave it out",
        )
    evaluation = evaluate(campaign) if isinstance(campaign, Campaign) else None
    renew = f"; run `pkmcal identify {quoted(str(campaign.folder))}` again"
    for number, identification in identifications.items():
        epoch = _epoch_of(campaign, identification, series.get(number))
        if evaluation is not None:
            epoch = _with_figures(epoch, identification, evaluation)
        if identification.is_by_older_model:
            note = f"{OLDER_MODEL}{renew if number == latest else ''}"
            epoch = replace(epoch, note=note)
        yield epoch
    for entry in left_out:
        is_latest = entry.record.body.get("series") == latest
        yield _left_out(campaign, "campaign", entry.at_utc, renew if is_latest else "")
    for entry in _unreadable(of_checks, read_check):
        yield _left_out(campaign, "check", entry.at_utc, "")
    for check in _readable(of_checks, read_check):
        yield Epoch(
            folder=str(campaign.folder),
            kind="check",
            measured_utc=_measured_utc(series.get(check.series), check.at_utc),
            decision=check.decision,
            says=check.says,
        )


def _readable(
    entries: Iterable[Entry[Finding]], read: Callable[[Mapping[str, JsonValue]], ResultT]
) -> Iterator[ResultT]:
    """Yield the findings that this version can read."""
    for entry in entries:
        with suppress(FindingUnreadable):
            yield read(entry.record.body)


def _unreadable(
    entries: Iterable[Entry[Finding]], read: Callable[[Mapping[str, JsonValue]], object]
) -> Iterator[Entry[Finding]]:
    """Yield the findings that another version wrote in a form that this one cannot read."""
    for entry in entries:
        try:
            read(entry.record.body)
        except FindingUnreadable:
            yield entry


def _left_out(
    campaign: CampaignFolder, kind: Literal["campaign", "check"], at_utc: str, renew: str
) -> Epoch:
    """Return the row of a finding that cannot be read: its time, and nothing of its contents."""
    return Epoch(
        folder=str(campaign.folder),
        kind=kind,
        measured_utc=at_utc,
        decision=None,
        says="",
        note=f"left out: another version of the software wrote it in another form{renew}",
    )


def _epoch_of(
    campaign: CampaignFolder, identification: RecordedIdentification, series: Series | None
) -> Epoch:
    """Return the epoch of an identification, as far as the journal alone states it."""
    judgement, errors = identification.judgement, identification.residuals.unseen_mm
    return Epoch(
        folder=str(campaign.folder),
        kind="campaign",
        measured_utc=_measured_utc(series, identification.provenance.at_utc),
        decision=judgement.verdict,
        says="" if judgement.verdict == "pass" else "; ".join(judgement.reasons),
        note="" if isinstance(campaign, Campaign) else UNREAD,
        by_older_model=identification.is_by_older_model,
        unseen_mm=errors.after.mean_abs if errors else None,
    )


def _with_figures(
    epoch: Epoch, identification: RecordedIdentification, evaluation: Evaluation
) -> Epoch:
    """Return an identification's epoch with what the robot's model adds: parameters and errors.

    `after_mm` is given only if the controller held this identification's values: a campaign has
    one validation after calibration, but may have several identifications.
    """
    mechanism = evaluation.evidence.campaign.robot.mechanism
    before, after = (
        stage.distances.mean.value_mm if stage and stage.distances else None
        for stage in (evaluation.before, evaluation.after)
    )
    held = evaluation.evidence.held("after")
    digest = identification.value.parameter_set(mechanism).digest()
    is_held = held is not None and held.origin == digest
    has_passed = identification.judgement.verdict == "pass"
    parameters = tuple(
        ParameterError(
            name,
            epoch.measured_utc,
            parameter.delta,
            parameter.std,
            mechanism.parameters[name].unit,
            identification.is_by_older_model,
        )
        for name, parameter in identification.value.parameters.items()
        if has_passed and parameter.free and parameter.std is not None
    )
    after_mm = after if is_held else None
    return replace(epoch, parameters=parameters, before_mm=before, after_mm=after_mm)


def _measured_utc(series: Series | None, at_utc: str) -> str:
    """Return the time of a series' last shot; `at_utc`, when it was judged, if it has no shots."""
    return max((each.measured_utc for each in series.shots), default=at_utc) if series else at_utc


def _require_one_robot(campaigns: Sequence[CampaignFolder]) -> None:
    """Raise `OptionsInvalid` for a folder named twice, or campaigns of different robots.

    A serial number that one of two campaigns lacks is not compared between these two.
    """
    if len({campaign.folder.resolve() for campaign in campaigns}) < len(campaigns):
        raise OptionsInvalid("DIR is named twice", remedy="name each campaign once")
    for first, other in combinations(campaigns, 2):
        for quantity, ours, theirs in _identities(first, other):
            if ours and theirs and ours != theirs:
                raise OptionsInvalid(
                    f"{other.folder} is of another robot than {first.folder}: {quantity} "
                    f"'{theirs}', not '{ours}'",
                    remedy="name campaigns of one robot",
                )


def _identities(first: CampaignFolder, other: CampaignFolder) -> Iterator[tuple[str, str, str]]:
    """Yield the identifying quantities of two campaigns: name, first value, other value.

    The controller's serial number counts only where the robot's own is missing: a controller may
    be exchanged.
    """
    if isinstance(first, Campaign) and isinstance(other, Campaign):
        yield "mechanism", first.robot.mechanism.name, other.robot.mechanism.name
    ours, theirs = (each.config.instruments.robot_serial for each in (first, other))
    yield "serial number", ours, theirs
    if not (ours and theirs):
        yield "controller's serial number", _controller(first), _controller(other)


def _controller(campaign: CampaignFolder) -> str:
    """Return the serial number of the controller that answered last; "" if none did."""
    with campaign.journal_reader() as journal:
        robots = [each.started.robot for each in journal.series() if each.started.robot]
    return robots[-1].serial if robots else ""
