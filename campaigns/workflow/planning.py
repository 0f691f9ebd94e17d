"""Planning of a campaign: poses chosen, checked and written, and the predicted uncertainty."""

# 1. Choose poses and their order: near the workspace's limits as in the paper, or optimal for the
#    positions after the fit. All randomness comes from one seed, so a plan can be made again.
# 2. Give known lengths and nests their shots, and check the whole plan as a run would: limits,
#    singularities, view of the tracker, every way between two shots.
# 3. Predict 1 σ of parameters and positions from the plan alone. The prediction assumes the model
#    that identification will fit by default, and the tracker's data sheet.
# 4. Write plan.csv; an older plan is renamed. Only this step holds the campaign: making an optimal
#    plan takes long, and other commands need not wait for it.

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.campaign import Campaign
from campaigns.design.pose_sampling import WorkspaceTooSmall
from campaigns.design.restricted_space import Refusals
from campaigns.fit.error_model import ErrorModel
from campaigns.identification.observations import error_model
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.repeats import PlannedVisits, planned_visits
from campaigns.measuring.stopping_rule import read_goal
from campaigns.options import PlanOptions
from campaigns.planning.forecast import Forecast, forecast, judged_both
from campaigns.planning.optimal_plan import MOST_SHOTS, OptimalRequest, make_optimal_plan
from campaigns.planning.plan_check import CheckedPlan, seconds_of_visits
from campaigns.planning.plan_file import PlannedShot, write_beside_older
from campaigns.planning.plans import Placement, make_plan, poses_of, with_nests
from campaigns.planning.validation_plan import SHORTEST_PART, fitting_lines
from campaigns.shots.shot_sets import ShotSet
from campaigns.workflow.identification import identification_options

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
    """

    checked: CheckedPlan
    forecast: Forecast
    placement: Placement
    seed: int
    visits: tuple[PlannedVisits, PlannedVisits]
    refusals: Refusals | None = None
    lines_mm: tuple[float, float, float] | None = None


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
        OptionsInvalid: Options contradict each other, or name unknown parameters.
        PlanInvalid: There is no such plan: too small a workspace, too few shots, an unsafe way.
        WriteFailed: plan.csv could not be written.

    Example:
        >>> planned = workflow.plan(campaign, PlanOptions(shots=80))
        >>> planned.forecast.position_std_mm.max()
    """
    options = options or PlanOptions()
    planned = _make_and_check(campaign, options, tell)
    with campaign.held():
        shots = planned.checked.shots
        write_beside_older(campaign.plan_path, shots, campaign.robot.mechanism)
    return planned


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
    checked = campaign.checked_plan(with_nests(shots, config.nests, config.known_lengths), tell)
    tell("predicting the uncertainty that the shots will give")
    judged, turns = judged_both(model, campaign.robot_model, poses_of(shots))
    tracker_mm = np.array(campaign.view.tracker_mm)
    predicted = forecast(shots, model, tracker_mm, campaign.instrument, judged, turns)
    return PlannedCampaign(
        checked,
        predicted,
        placement,
        seed,
        _visits(campaign, checked.shots, predicted.freedom),
        _refusals(campaign, rng),
        _fitting_lines_mm(campaign),
    )


def _visits(
    campaign: Campaign, shots: Sequence[PlannedShot], fit_freedom: float
) -> tuple[PlannedVisits, PlannedVisits]:
    """Return what the plan's visits of the drift pose will show, and what twice as many would."""
    visits = sum(shot.purpose is ShotSet.DRIFT for shot in shots)
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
