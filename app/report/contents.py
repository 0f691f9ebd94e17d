"""Everything that the page shows, computed once from the evidence."""

from dataclasses import dataclass

from app.report.checks import Check, integrity_checks
from app.report.conformity import Verdict, verdict
from app.report.evidence import Evidence
from app.report.explained import Correlations, ResidualBudget, correlations_of, residual_budget
from app.report.model_errors import ModelErrors, model_errors, models_of
from app.report.over_time import TimeSeries, time_series
from app.report.stages import StageView, stage_view
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.robots.robot import numeric_geometry


@dataclass(frozen=True, slots=True, eq=False)
class Contents:
    """None: the campaign does not have it yet."""

    evidence: Evidence
    before: StageView | None
    after: StageView | None
    errors: ModelErrors | None
    correlations: Correlations | None
    remainder: ResidualBudget | None
    checks: tuple[Check, ...]
    verdict: Verdict
    courses: tuple[TimeSeries, ...]


def contents_of(evidence: Evidence, instrument: TrackerUncertainty) -> Contents:
    """Compute it; `instrument` stands in for shots of which the tracker stated no uncertainty."""
    before = None if evidence.before is None else stage_view(evidence.before, instrument)
    after = None if evidence.after is None else stage_view(evidence.after, instrument)
    errors = _errors(evidence, instrument)
    checks = integrity_checks(evidence)
    limits = evidence.campaign.config.acceptance
    return Contents(
        evidence,
        before,
        after,
        errors,
        None if evidence.identification is None else correlations_of(evidence.identification),
        _remainder(evidence, errors, after or before),
        checks,
        verdict(evidence.identification, after, limits, checks),
        _courses(evidence),
    )


def _errors(evidence: Evidence, instrument: TrackerUncertainty) -> ModelErrors | None:
    if evidence.run is None:
        return None
    found = evidence.identification
    models = models_of(found, numeric_geometry(evidence.campaign.nominal.robot))
    return model_errors(evidence.run, models, found.excluded if found else (), instrument)


def _remainder(
    evidence: Evidence, errors: ModelErrors | None, stage: StageView | None
) -> ResidualBudget | None:
    found = evidence.identification
    if found is None or errors is None:
        return None
    repeated = stage.cloud.away_mm if stage and stage.cloud else None
    return residual_budget(errors, found, repeated)


def _courses(evidence: Evidence) -> tuple[TimeSeries, ...]:
    every = (time_series(name, measured) for name, measured in evidence.by_stage())
    return tuple(each for each in every if not each.is_empty)
