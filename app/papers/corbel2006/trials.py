"""What one seed of an experiment has given, as it is kept; lengths in mm, angles in deg."""

from collections.abc import Iterator

import numpy as np
from pydantic import BaseModel, ConfigDict

from app.exits import AppError
from app.folder import Campaign
from app.papers.corbel2006.experiments import Trial
from app.report.collect import collect
from app.report.evidence import MeasuredSeries
from app.report.findings import IdentificationFinding
from app.report.model_errors import PairErrors, model_errors, models_of
from app.wiring import scenario_of
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.evaluation.validation import (
    AXES,
    distance_trace,
    evaluate_validation,
    measured_test,
    of_set,
)
from campaigns.robots.robot import numeric_geometry
from campaigns.shots.shot_sets import ShotSet


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
    evidence = collect(campaign)
    found, run, before, after = (
        evidence.identification,
        evidence.run,
        evidence.before,
        evidence.after,
    )
    if found is None or run is None or before is None or after is None:
        raise _incomplete(trial, "series")
    instrument = TrackerUncertainty()
    models = models_of(found, numeric_geometry(campaign.nominal.robot))
    errors = model_errors(run, models, found.excluded, instrument)
    return TrialResult(
        experiment=trial.experiment.name,
        seed=trial.seed,
        recipe=trial.experiment.recipe(),
        seconds=seconds,
        parameters=dict(_estimates(campaign, found)),
        fitted=_errors(trial, errors.fitted),
        unseen=_errors(trial, errors.unseen),
        before=_stage(trial, before, instrument),
        after=_stage(trial, after, instrument),
    )


def _estimates(campaign: Campaign, found: IdentificationFinding) -> Iterator[tuple[str, Estimate]]:
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


def _stage(trial: Trial, measured: MeasuredSeries, instrument: TrackerUncertainty) -> Stage:
    found = evaluate_validation(measured.shots)
    pairs = distance_trace(measured_test(of_set(measured.shots, ShotSet.VALIDATION), instrument))
    straight, repeated, frame = found.straightness_mm or {}, found.repeatability, found.frame
    if pairs is None or found.rotation_mm is None or repeated is None or frame is None:
        raise _incomplete(trial, f"tests of stage '{measured.series.started.stage}'")
    if set(straight) != set(AXES):
        raise _incomplete(trial, "lines")
    return Stage(
        lengths_mm=tuple(pairs.commanded_mm.tolist()),
        errors_mm=tuple(pairs.errors_mm.tolist()),
        rotation_mm=found.rotation_mm,
        straightness_mm=dict(straight),
        radius_mm=repeated.radius_mm,
        rp_mm=repeated.rp_mm,
        frame_mean_mm=frame.mean,
        frame_max_mm=frame.max,
    )


def _incomplete(trial: Trial, what: str) -> TrialFailed:
    return TrialFailed(f"{trial}: {what} are missing", remedy="try this seed again")
