"""Planning of a campaign: poses chosen, checked and written, and the predicted uncertainty."""

# 1. Choose poses and their order: near the workspace's limits as in the paper, or optimal for the
#    positions after the fit. All randomness comes from one seed, so a plan can be made again.
# 2. Give known lengths and nests their shots, and check the whole plan as a run would: limits,
#    singularities, view of the tracker, every way between two shots.
# 3. Predict 1 σ of parameters and positions from the plan alone. The prediction assumes the model
#    that identification will fit by default, and the tracker's data sheet.
# 4. If campaign.yaml has objects, choose observations of them, and state what all of it together
#    will determine (`observation_plan.py`).
# 5. Write plan.csv; an older plan is renamed, and one that was measured is replaced only by consent
#    (`force`): a delivered result must not be undone in passing. Only this step holds the
#    campaign: making an optimal plan takes long, and other commands need not wait for it.

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from campaigns.campaign import Campaign
from campaigns.design.pose_sampling import WorkspaceTooSmall
from campaigns.design.restricted_space import Refusals
from campaigns.errors import OptionsInvalid, PlanInvalid
from campaigns.files.wording import shown, suggestion
from campaigns.fit.error_model import ErrorModel
from campaigns.identification.observations import error_model
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.repeats import PlannedVisits, planned_visits
from campaigns.measuring.stopping_rule import read_goal
from campaigns.options import PlanOptions
from campaigns.planning.forecast import Forecast, forecast, judged_both
from campaigns.planning.optimal_plan import MOST_SHOTS, OptimalRequest, make_optimal_plan
from campaigns.planning.plan_check import CheckedPlan, seconds_of_visits
from campaigns.planning.plan_file import PlannedShot, series_by_plan, write_beside_older
from campaigns.planning.plans import Placement, in_turn, make_plan, pairs_of, poses_of, with_nests
from campaigns.planning.validation_plan import SHORTEST_PART, fitting_lines
from campaigns.settings.option import typed_words
from campaigns.shots.observation_records import recorded_observations
from campaigns.shots.observations_csv import FILE_NAME as OBSERVATIONS
from campaigns.shots.shot_sets import ShotSet
from campaigns.workflow.identification import identification_options
from campaigns.workflow.observation_plan import (
    PlannedObservations,
    plan_observations,
    write_planned,
)
from campaigns.workflow.work import all_series

REFUSALS_SAMPLE = 2000
"""Number of poses drawn to find the share that the restricted space refuses."""


@dataclass(frozen=True, slots=True)
class PlannedCampaign:
    """Result of planning: the written plan, and the uncertainty that it will give.

    Attributes:
        checked: The shots in measuring order, the detours between them, and the time they take.
        forecast: Predicted 1 σ of parameters and positions.
        placement: How the poses were chosen.
        seed: Seed of the random generator.
        visits: What the plan's visits of the drift pose will show of the scatter, and what twice as
            many would, with the time that the further ones take.
        refusals: Shares of poses that the restricted space refuses; None without such a space.
        lines_mm: Lengths of validation lines that would fit, mm, where those in campaign.yaml are
            too long; None where they fit.
        observations: Observations of other kinds that are planned beside the shots, and what
            further ones would gain; None where campaign.yaml has no objects.
        older: Path under which the plan before is kept; None without one.
    """

    checked: CheckedPlan
    forecast: Forecast
    placement: Placement
    seed: int
    visits: tuple[PlannedVisits, PlannedVisits]
    refusals: Refusals | None = None
    lines_mm: tuple[float, float, float] | None = None
    observations: PlannedObservations | None = None
    older: Path | None = None


def plan(
    campaign: Campaign,
    options: PlanOptions | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> PlannedCampaign:
    """Make, check and write plan.csv; an older plan is kept under another name.

    Args:
        campaign: The campaign.
        options: Options of `pkmcal plan`; by default campaign.yaml decides.
        `tell`: Receives words on the progress.

    Returns:
        The checked plan with its predicted uncertainty.

    Raises:
        OptionsInvalid: Options contradict each other, or name unknown parameters; or shots of
            the plan that is there are measured, which `force` in the options overrules.
        PlanInvalid: There is no such plan: too small a workspace, too few shots, an unsafe way.
        WriteFailed: plan.csv could not be written.

    Example:
        >>> planned = workflow.plan(campaign, PlanOptions(shots=80))
        >>> planned.forecast.position_std_mm.max()
    """
    options = options or PlanOptions()
    if not options.force and (objection := replaced_plan(campaign)):
        raise objection
    if options.observe:
        _require_observations_unmeasured(campaign, options)
    planned = _make_and_check(campaign, options, tell)
    with campaign.held():
        shots, mechanism = planned.checked.shots, campaign.robot.mechanism
        words = typed_words(replace(options, force=False))
        older = write_beside_older(campaign.plan_path, shots, mechanism, words)
        planned = replace(planned, older=older)
        if planned.observations is not None:
            written = write_planned(campaign, planned.observations)
            planned = replace(planned, observations=written)
    return planned


def replaced_plan(campaign: Campaign) -> OptionsInvalid | None:
    """Return the objection to a plan in the place of one that was measured; None without one."""
    # What was identified from the shots of a plan rests on this plan: with another plan.csv its
    # verdict is open again, and the next run would measure with the parameters loaded by then. A
    # validation before calibration would be at other poses than the one after it.
    if not campaign.plan_path.exists():
        return None
    try:
        plan = campaign.read_plan()
    except PlanInvalid:
        return None
    series = series_by_plan(plan, all_series(campaign))
    if series is None:
        return None
    count, started = len(series.shots), series.started
    measured = f"is the plan of series {series.number}, {count} shots of which are measured"
    if started.imported:
        measured = f"may be the plan of series {series.number}, {count} shots that were imported"
    of_stage = "" if started.stage in {"run", "import"} else f" (stage {started.stage})"
    return OptionsInvalid(
        f"{campaign.plan_path} {measured}{of_stage}: with another plan its results are open again",
        remedy="make a campaign of its own with `pkmcal new`; --force plans anew and keeps this "
        "plan beside it",
        options="--force",
    )


def replaced_observations_plan(campaign: Campaign) -> OptionsInvalid | None:
    """Return the objection to an observations.csv in the place of a measured one; None without."""
    path = campaign.path(OBSERVATIONS)
    if not (path.exists() and campaign.journal_path.exists()):
        return None
    with campaign.journal_reader() as journal:
        files = recorded_observations(journal).files
    measured = next((file for file in files if file.name == OBSERVATIONS), None)
    if measured is None:
        return None
    return OptionsInvalid(
        f"{path} is the plan of observations that are measured or imported, {len(measured.rows)} "
        "by now: with another one their results are open again",
        remedy="make a campaign of its own with `pkmcal new`; --force plans anew and keeps this "
        "file beside it",
        options="--force",
    )


def plan_without_shots(campaign: Campaign, options: PlanOptions) -> PlannedObservations:
    """Plan observations of other kinds alone, without a tracker, and write observations.csv.

    Raise `OptionsInvalid`, `PlanInvalid` and `WriteFailed` as `plan` does.
    """
    _require_observations_unmeasured(campaign, options)
    observations, _ = plan_observations(
        campaign,
        options.observe,
        options.quantity,
        planned_model(campaign, options.fix),
        _rng_of_observations(campaign, options),
    )
    with campaign.held():
        return write_planned(campaign, observations)


def _require_observations_unmeasured(campaign: Campaign, options: PlanOptions) -> None:
    """Raise `OptionsInvalid` if a measured observations.csv would be replaced without consent."""
    if not options.force and (objection := replaced_observations_plan(campaign)):
        raise objection


def planned_model(campaign: Campaign, fix: tuple[str, ...] = ()) -> ErrorModel:
    """Return the model of all sources of error that identification will fit to a plan's shots.

    `fix` holds names or patterns of parameters that keep their nominal values.
    """
    fit_options = identification_options(campaign, IdentificationOptions(fix=fix))
    return error_model(campaign.robot.kinematics, None, fit_options)


def _make_and_check(
    campaign: Campaign, options: PlanOptions, tell: Callable[[str], None]
) -> PlannedCampaign:
    """Make and check a plan; nothing is written."""
    config, robot, model = campaign.config, campaign.robot, planned_model(campaign, options.fix)
    until_mm = None if options.until is None else read_goal(options.until)
    # with a goal and no number of shots, the plan grows until the goal is met or the limit reached
    most = MOST_SHOTS if options.shots is None and until_mm is not None else options.shots
    request = OptimalRequest(
        plan=campaign.plan_request(most),
        model=model,
        uncertainty=campaign.instrument,
        until_mm=until_mm,
    )
    # shots near the limits of the workspace are drawn, not chosen one by one: no goal stops them
    requested = Placement.OPTIMAL if until_mm is not None else options.placement
    placement = requested or Placement(config.plan.placement)
    seed = config.plan.seed if options.seed is None else options.seed
    rng = np.random.default_rng(seed)
    tell("choosing poses and their order")
    if placement is Placement.OPTIMAL:
        shots = make_optimal_plan(robot, campaign.view, request, rng)
    else:
        shots = make_plan(robot, campaign.view, request.plan, rng)
    shots = _in_turn(campaign, options.reflector, shots)
    checked = campaign.checked_plan(with_nests(shots, config.nests, config.known_lengths), tell)
    tell("predicting the uncertainty that the shots will give")
    judged, turns = judged_both(model, campaign.robot_model, poses_of(shots))
    tracker_mm = np.array(campaign.view.tracker_mm)
    predicted = forecast(shots, model, tracker_mm, campaign.instrument, judged, turns)
    observations = None
    if config.objects or options.observe:
        tell("comparing what observations of other kinds will gain")
        observations, expected = plan_observations(
            campaign,
            options.observe,
            options.quantity,
            model,
            _rng_of_observations(campaign, options),
            (checked.shots, checked.seconds / len(checked.shots)),
        )
        fitted = pairs_of(checked.shots, ShotSet.IDENTIFICATION)
        predicted = replace(expected.forecast(predicted), shots=fitted.size)
    return PlannedCampaign(
        checked,
        predicted,
        placement,
        seed,
        _visits(campaign, checked.shots, predicted.freedom),
        _refusals(campaign, rng),
        _fitting_lines_mm(campaign),
        observations,
    )


def _rng_of_observations(campaign: Campaign, options: PlanOptions) -> np.random.Generator:
    """Return the generator of observations: the shots of a seed are those without any."""
    seed = campaign.config.plan.seed if options.seed is None else options.seed
    return np.random.default_rng([seed, 1])


def _in_turn(
    campaign: Campaign, names: Sequence[str], shots: tuple[PlannedShot, ...]
) -> tuple[PlannedShot, ...]:
    """Return a plan whose pairs are of the reflector where robot.yaml says and at objects in turn.

    Raise `OptionsInvalid` for an object that carries no reflector.
    """
    carriers = [thing.name for thing in campaign.config.objects if thing.body is not None]
    for name in names:
        if name not in carriers:
            raise OptionsInvalid(
                f"--reflector {shown(name)} is no object of campaign.yaml that a body carries",
                remedy=suggestion(name, carriers)
                if carriers
                else "list it under objects, as {name: half 2, body: half 2}",
            )
    return in_turn(shots, ("", *dict.fromkeys(names))) if names else shots


def _visits(
    campaign: Campaign, shots: Sequence[PlannedShot], fit_freedom: float
) -> tuple[PlannedVisits, PlannedVisits]:
    """Return what the plan's visits of the drift pose will show, and what twice as many would."""
    # visits of a reflector elsewhere are of another point
    visits = sum(shot.purpose is ShotSet.DRIFT and not shot.reflector for shot in shots)
    seconds = seconds_of_visits(visits, shots, campaign.robot.kinematics, campaign.pace)
    return planned_visits(visits, fit_freedom), planned_visits(2 * visits, fit_freedom, seconds)


def _fitting_lines_mm(campaign: Campaign) -> tuple[float, float, float] | None:
    """Return lengths of validation lines that fit, mm; None if those of campaign.yaml do."""
    robot, stated_mm = campaign.robot, campaign.config.validation.line_lengths_mm
    fitting = fitting_lines(
        robot.kinematics, robot.limits, campaign.centre, stated_mm, campaign.space
    )
    pairs = zip(fitting, stated_mm, strict=True)
    return fitting if any(mm < SHORTEST_PART * wanted for mm, wanted in pairs) else None


def _refusals(campaign: Campaign, rng: np.random.Generator) -> Refusals | None:
    """Return how many random poses the restricted space refuses; None without such a space."""
    if not campaign.space.is_restricted:
        return None
    try:
        return campaign.region.refusals(REFUSALS_SAMPLE, rng)
    except WorkspaceTooSmall:
        return None
