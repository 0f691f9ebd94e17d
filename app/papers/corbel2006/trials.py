"""What one seed of an experiment has given, as it is kept; lengths in mm, angles in deg."""

from collections.abc import Iterator

import numpy as np
from pydantic import BaseModel, ConfigDict

from app.exits import AppError
from app.papers.corbel2006.experiments import Trial
from app.wiring import scenario_of
from campaigns.campaign import Campaign
from campaigns.evaluation.model_errors import PairErrors
from campaigns.evaluation.validation import AXES, ValidationResult
from campaigns.evidence import evaluate, gather
from campaigns.identification.result import RecordedIdentification


class TrialFailed(AppError):
    """A seed has not come to its end: its figures don't count."""


class _Kept(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class Errors(_Kept):
    """Modelled minus measured distances of pairs, with the nominal and the identified geometry."""

    before_mm: tuple[float, ...]
    after_mm: tuple[float, ...]


class Stage(_Kept):
    """What the tests of section IV.E show before or after."""

    lengths_mm: tuple[float, ...]
    """Commanded distances of the validation pairs."""
    errors_mm: tuple[float, ...]
    """Commanded minus measured."""
    rotation_mm: float
    straightness_mm: dict[str, float]
    """By axis."""
    radius_mm: float
    """Of the sphere of repeatability."""
    rp_mm: float
    frame_mean_mm: float
    frame_max_mm: float

    @property
    def distance_mean_mm(self) -> float:
        """Mean of the absolute errors."""
        return float(np.abs(self.errors_mm).mean())

    @property
    def distance_max_mm(self) -> float:
        """Largest absolute error."""
        return float(np.abs(self.errors_mm).max())


class Estimate(_Kept):
    """A parameter that was identified: errors are what it differs by from nominal."""

    true_error: float
    estimated_error: float
    std: float | None

    @property
    def missed_by(self) -> float:
        """Estimated minus true."""
        return self.estimated_error - self.true_error


class TrialResult(_Kept):
    """One seed's figures."""

    experiment: str
    seed: int
    recipe: str
    seconds: float
    parameters: dict[str, Estimate]
    fitted: Errors
    unseen: Errors
    before: Stage
    after: Stage

    def missed(self, unit: str) -> list[float]:
        """By how much each parameter of this unit is missed, without signs."""
        return [
            abs(e.missed_by) for name, e in self.parameters.items() if name.endswith(f"_{unit}")
        ]


def result_of(campaign: Campaign, trial: Trial, seconds: float) -> TrialResult:
    """The figures of a campaign that went through the whole chain; raises `TrialFailed`."""
    evaluation = evaluate(gather(campaign))
    found, errors = evaluation.evidence.identification, evaluation.errors
    if found is None or errors is None:
        raise _incomplete(trial, "series")
    return TrialResult(
        experiment=trial.experiment.name,
        seed=trial.seed,
        recipe=trial.experiment.recipe(),
        seconds=seconds,
        parameters=dict(_estimates(campaign, found)),
        fitted=_errors(trial, errors.fitted),
        unseen=_errors(trial, errors.unseen),
        before=_stage(trial, evaluation.before),
        after=_stage(trial, evaluation.after),
    )


def _estimates(campaign: Campaign, found: RecordedIdentification) -> Iterator[tuple[str, Estimate]]:
    """Of what was identified, beside the simulated robot's own parameters."""
    true = scenario_of(campaign.folder, campaign.config.controller.url).robot.true_flat()
    for name in found.free:
        parameter = found.parameters[name]
        yield (
            name,
            Estimate(
                true_error=true[name] - parameter.nominal,
                estimated_error=parameter.delta,
                std=parameter.std,
            ),
        )


def _errors(trial: Trial, found: PairErrors | None) -> Errors:
    if found is None or found.after_mm is None:
        raise _incomplete(trial, "errors of pairs")
    return Errors(
        before_mm=tuple(found.before_mm.tolist()), after_mm=tuple(found.after_mm.tolist())
    )


def _stage(trial: Trial, found: ValidationResult | None) -> Stage:
    if found is None:
        raise _incomplete(trial, "validations")
    pairs, rotation, repeated = found.distances, found.rotation, found.repeatability
    if pairs is None or rotation is None or repeated is None or found.absolute_mm is None:
        raise _incomplete(trial, "tests of a validation")
    if {line.axis for line in found.lines} != set(AXES):
        raise _incomplete(trial, "lines")
    return Stage(
        lengths_mm=tuple(pairs.commanded_mm.tolist()),
        errors_mm=tuple(pairs.errors_mm.tolist()),
        rotation_mm=rotation.moved.value_mm,
        straightness_mm={line.axis: line.straightness.value_mm for line in found.lines},
        radius_mm=repeated.radius.value_mm,
        rp_mm=repeated.rp_mm,
        frame_mean_mm=float(found.absolute_mm.mean()),
        frame_max_mm=float(found.absolute_mm.max()),
    )


def _incomplete(trial: Trial, what: str) -> TrialFailed:
    return TrialFailed(f"{trial}: {what} are missing", remedy="try this seed again")
