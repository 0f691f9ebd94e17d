"""History of a robot: what the journals of its campaigns hold of parameters, errors and checks."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import Literal

from campaigns.campaign import Campaign
from campaigns.errors import OptionsInvalid, ShotsMissing
from campaigns.evaluation.decision import Decision
from campaigns.evidence import Evaluation, evaluate
from campaigns.identification.checking import read_check
from campaigns.identification.result import RecordedIdentification, read_identification
from campaigns.journal.views import Series


@dataclass(frozen=True, slots=True)
class ParameterError:
    """Identified minus nominal value of a parameter with its σ, mm or deg, at a time."""

    name: str
    measured_utc: str
    delta: float
    std: float
    unit: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Epoch:
    """Identification or check; mean errors of distances are mm, None where none were measured.

    `before` and `after` are of the robot as commanded, `unseen_mm` of hold-out pairs by the model.
    """

    folder: str
    kind: Literal["campaign", "check"]
    measured_utc: str
    """When its last shot was measured."""
    decision: Decision
    says: str
    parameters: tuple[ParameterError, ...] = field(default=(), repr=False)
    """Of an identification that passed."""
    before_mm: float | None = None
    after_mm: float | None = None
    unseen_mm: float | None = None


def history(campaigns: Sequence[Campaign]) -> tuple[Epoch, ...]:
    """Collect identifications and checks of one robot's campaigns in the order of time.

    Raises `OptionsInvalid` for different robots or a folder named twice, and `ShotsMissing`.
    """
    epochs = [epoch for campaign in campaigns for epoch in _epochs(campaign)]
    _require_one_robot(campaigns)
    return tuple(sorted(epochs, key=lambda epoch: datetime.fromisoformat(epoch.measured_utc)))


def _epochs(campaign: Campaign) -> Iterator[Epoch]:
    """Read a campaign's latest identification of each series, and its checks."""
    with campaign.journal_reader() as journal:
        series = {each.number: each for each in journal.series()}
        results = [read_identification(e.record.body) for e in journal.findings("identification")]
        checks = [read_check(entry.record.body) for entry in journal.findings("check")]
    identifications = {result.series: result for result in results}
    if not identifications:
        raise ShotsMissing(
            f"{campaign.folder}: nothing has been identified yet",
            remedy=f"`pkmcal identify {campaign.folder}`, or leave it out",
        )
    evaluation = evaluate(campaign)
    for number, identification in identifications.items():
        yield _epoch_of(campaign, identification, series.get(number), evaluation)
    for check in checks:
        yield Epoch(
            folder=str(campaign.folder),
            kind="check",
            measured_utc=_measured_utc(series.get(check.series), check.at_utc),
            decision=check.decision,
            says=check.says,
        )


def _epoch_of(
    campaign: Campaign,
    identification: RecordedIdentification,
    series: Series | None,
    evaluation: Evaluation,
) -> Epoch:
    """Return the epoch of an identification; `after` only if the controller held its values."""
    space, good = campaign.robot.mechanism.parameters, identification.verdict == "pass"
    measured_utc = _measured_utc(series, identification.at_utc)
    before, after = (
        stage.distances.mean.value_mm if stage and stage.distances else None
        for stage in (evaluation.before, evaluation.after)
    )
    held = evaluation.evidence.held("after")
    digest = identification.parameter_set(campaign.robot.mechanism).digest()
    is_held = held is not None and held.origin == digest
    return Epoch(
        folder=str(campaign.folder),
        kind="campaign",
        measured_utc=measured_utc,
        decision=identification.verdict,
        says="" if good else "; ".join(identification.reasons),
        parameters=tuple(
            ParameterError(name, measured_utc, parameter.delta, parameter.std, space[name].unit)
            for name, parameter in identification.parameters.items()
            if good and parameter.free and parameter.std is not None
        ),
        before_mm=before,
        after_mm=after if is_held else None,
        unseen_mm=identification.unseen_mm.after.mean_abs if identification.unseen_mm else None,
    )


def _measured_utc(series: Series | None, at_utc: str) -> str:
    """Return when the last shot was measured, or, if the journal lacks it, judged."""
    return max((each.measured_utc for each in series.shots), default=at_utc) if series else at_utc


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
    """Return what must be the same; a robot's serial number outranks its controller's."""
    yield "mechanism", first.robot.mechanism.name, other.robot.mechanism.name
    ours, theirs = (each.config.instruments.robot_serial for each in (first, other))
    yield "serial number", ours, theirs
    if not (ours and theirs):
        yield "controller's serial number", _controller(first), _controller(other)


def _controller(campaign: Campaign) -> str:
    with campaign.journal_reader() as journal:
        robots = [each.started.robot for each in journal.series() if each.started.robot]
    return robots[-1].serial if robots else ""
