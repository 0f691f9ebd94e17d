"""Assessment: the evaluation of what a campaign's folder holds, as one value."""

# `Evaluation` derives from the evidence, part by part when it is needed: the figures of both
# validations, the gains, the errors of both models, the checks and the verdict. Report, live page,
# `status` and next step take their statements from here and judge nothing themselves, so that they
# cannot contradict each other.

from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from functools import cached_property
from typing import Literal

import numpy as np

from campaigns.campaign import Campaign
from campaigns.chain import checks_of_chain
from campaigns.evaluation import model_errors, validation
from campaigns.evaluation.robot_scatter import RobotScatter
from campaigns.evaluation.time_series import TimeSeries, time_series
from campaigns.evaluation.verdict import (
    CampaignVerdict,
    Check,
    Gain,
    IdentificationVerdict,
    ValidationVerdict,
    campaign_verdict,
    gained_in_words,
    gains,
    lost_beyond,
    validation_verdict,
    worse_than_before,
)
from campaigns.evidence import STAGES, Evidence, MeasuredSeries, gather
from campaigns.shots.shot_sets import ShotSet


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Evaluation of a campaign: what its report shows, computed at first use.

    Each attribute is None or empty if the campaign has not got that far.

    Attributes:
        evidence: Everything read from the campaign's folder.
        before: Figures of the validation before calibration, mm, with their uncertainties.
        after: Figures of the validation after calibration.
        scatter: The robot's scatter, which is in the uncertainties of both.
        gains: Each figure before and after.
        errors: Errors of the nominal and the identified model at the measured shots, mm.
        checks: Statements on whether plan, journal, files and controller belong together.
        time_series: Temperature and drift of each series.
        verdict: Decision on the whole campaign, with its reasons.
    """

    evidence: Evidence

    @cached_property
    def scatter(self) -> RobotScatter:
        """Scatter of the robot: by the identification, else by the latest repeated visits."""
        robot, identification = self.evidence.campaign.robot, self.evidence.identification
        if identification and (scatter := identification.uncertainty.scatter) is not None:
            fitted = identification.residuals.fitted
            shots = len(fitted.numbers) if fitted is not None else identification.provenance.shots
            return RobotScatter.identified(scatter.point_mm, scatter.joint, shots, robot.kinematics)
        measured = (*self.evidence.before, *self.evidence.after)
        by_visits = (validation.scatter_of_visits(item.shots) for item in reversed(measured))
        return next((scatter for scatter in by_visits if scatter.is_known), RobotScatter())

    @cached_property
    def before(self) -> validation.ValidationResult | None:
        """Figures of the validation before calibration: of each test the latest."""
        return self._validation(self.evidence.before)

    @cached_property
    def after(self) -> validation.ValidationResult | None:
        """Figures of the validation after calibration: of each test the latest."""
        return self._validation(self.evidence.after)

    @cached_property
    def gains(self) -> tuple[Gain, ...]:
        """Each figure of the commanded robot before and after."""
        return gains(self.before, self.after)

    @cached_property
    def errors(self) -> model_errors.ModelErrors | None:
        """Errors of the nominal and the identified model at the measured shots, mm."""
        modelled = _modelled(self.evidence)
        if modelled is None:
            return None
        return model_errors.ModelErrors(
            model_errors.pair_errors(modelled, ShotSet.IDENTIFICATION),
            model_errors.pair_errors(modelled, ShotSet.VALIDATION),
            model_errors.position_errors(modelled),
        )

    @cached_property
    def checks(self) -> tuple[Check, ...]:
        """Statements on whether plan, journal, files and controller belong together."""
        return tuple(checks_of_chain(self.evidence))

    @cached_property
    def time_series(self) -> tuple[TimeSeries, ...]:
        """Temperature and drift of each series that has them."""
        courses = (time_series(name, each.shots) for name, each in self.evidence.by_stage())
        return tuple(course for course in courses if not course.is_empty)

    def validated(self, stage: Literal["before", "after"]) -> ValidationVerdict:
        """Return the verdict on a stage by the limits in campaign.yaml.

        After calibration the robot must also not be worse than before, and a reduced form must
        not lose more than a limit anywhere in the workspace.
        """
        limits = self.evidence.campaign.config.acceptance
        axes = self.evidence.campaign.robot.mechanism.line_axes
        if stage == "before":
            return validation_verdict(self.before, limits, axes=axes)
        held = self.evidence.held("after")
        form = held.form if held else None
        worse = worse_than_before(self.gains)
        return validation_verdict(self.after, limits, worse, lost_beyond(form, limits), axes)

    @cached_property
    def verdict(self) -> CampaignVerdict:
        """Verdict on the whole campaign."""
        identification, of_identification = self.evidence.identification, None
        if identification is not None:
            judged = identification.judgement
            of_identification = IdentificationVerdict(
                judged.verdict, judged.reasons, judged.accepted
            )
        return campaign_verdict(
            of_identification,
            self.validated("after"),
            self.checks,
            validated=self.after is not None,
            notes=(*self._held_in_words(), *_limits_set_later(self.evidence)),
            gained=gained_in_words(
                self.gains, identification.residuals.unseen_mm if identification else None
            ),
        )

    def _held_in_words(self) -> Iterator[str]:
        """Yield sentences on what the controller held, where it was a form or was declared."""
        for stage in STAGES:
            held = self.evidence.held(stage)
            if held is not None and (held.form or held.declared):
                yield f"Validated {stage} with {held.says}."

    def _validation(
        self, measured: tuple[MeasuredSeries, ...]
    ) -> validation.ValidationResult | None:
        """Return the figures of a stage's series; None without any."""
        campaign = self.evidence.campaign
        return validation.latest_of_each_test(
            validation.evaluate_validation(
                item.stops,
                campaign.instrument_of(item.series.started).uncertainty,
                item.series.number,
                self.scatter,
            )
            for item in measured
        )


def evaluate(campaign: Campaign) -> Evaluation:
    """Evaluate all that a campaign has: figures, gains, checks and verdict, as its report has them.

    Args:
        campaign: The campaign, from `open_campaign`; at any stage.

    Returns:
        `before`, `after`, `gains`, `errors`, `checks`, `time_series` and `verdict`, computed at
        first use; None or empty where the campaign has not got that far.

    Raises:
        JournalFailed: The journal cannot be read.

    Example:
        >>> evaluation = evaluate(open_campaign("cell-7"))
        >>> evaluation.verdict.decision
        'pass'
        >>> evaluation.after.distances.mean.value_mm
    """
    return Evaluation(gather(campaign))


def _modelled(evidence: Evidence) -> model_errors.ModelledShots | None:
    """Return the identified and the hold-out shots, with the poses of both models.

    Before an identification there is the nominal model alone, at shots that it can assemble. None
    without shots, and for an old identification that kept no poses.
    """
    if evidence.run is None:
        return None
    identification, nominal = evidence.identification, evidence.campaign.robot.kinematics
    shots = evidence.run.stops.of_set(ShotSet.IDENTIFICATION, ShotSet.VALIDATION)
    if identification is None:
        solution, after = nominal.forward(shots.joints), None
        rows = np.flatnonzero(solution.is_solved)
        shots, before = shots.rows(rows), solution.values[rows]
    elif identification.residuals.modelled is None:  # by the paper's method in an older version
        return None
    else:
        # The identification kept which shots it used and how: options may have moved shots
        # between the sets, or left them out. Its table counts, not the plan's purposes.
        table = identification.residuals.modelled
        if not set(table.numbers) <= set(shots.numbers):  # of a version that averaged no samples
            shots = evidence.run.shots
        rows_by_number = {number: row for row, number in enumerate(shots.numbers)}
        rows = np.array([rows_by_number[number] for number in table.numbers], dtype=np.intp)
        shots = replace(shots.rows(rows), purposes=table.purposes, pairs=table.pairs)
        before, after = np.array(table.before), np.array(table.after)
    return model_errors.ModelledShots(
        shots=shots,
        before=before,
        after=after,
        points=nominal.points,
        sessions=identification is not None and bool(identification.value.sessions),
    )


def _limits_set_later(evidence: Evidence) -> Iterator[str]:
    """Yield a sentence if the limits were set or changed after the validation after calibration."""
    # Limits may be agreed late, but a reader of the verdict has to know: they could be chosen so
    # that the measured figures meet them.
    after = evidence.after[-1].series.started if evidence.after else None
    recorded = after.configuration.get("acceptance") if after else None
    config = evidence.campaign.config.acceptance.model_dump(mode="json")
    if not isinstance(recorded, dict) or not any(config.values()):
        return
    # a limit that the journal's version did not know was not set then
    if {**dict.fromkeys(config), **recorded} != config:
        changed_s = evidence.campaign.path("campaign.yaml").stat().st_mtime
        moment = datetime.fromtimestamp(changed_s, UTC).isoformat(" ", "minutes")
        yield f"Limits set after that validation, in campaign.yaml of {moment}."
