"""Planning of a campaign: poses chosen, checked and written, and the predicted uncertainty."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from campaigns.campaign import Campaign
from campaigns.design.pose_sampling import WorkspaceTooSmall
from campaigns.design.restricted_space import Refusals
from campaigns.fit.error_model import ErrorModel
from campaigns.identification.observations import error_model
from campaigns.identification.options import IdentificationOptions
from campaigns.measuring.stopping_rule import read_goal
from campaigns.options import PlanOptions
from campaigns.planning.forecast import Forecast, forecast, judged_positions
from campaigns.planning.optimal_plan import MOST_SHOTS, OptimalRequest, make_optimal_plan
from campaigns.planning.plan_check import CheckedPlan
from campaigns.planning.plan_file import write_beside_older
from campaigns.planning.plans import Placement, make_plan, poses_of, with_nests
from campaigns.planning.validation_plan import SHORTEST_PART, fitting_lines
from campaigns.workflow.identification import identification_options

REFUSALS_SAMPLE = 2000
"""Poses drawn to count how many the space refuses."""


@dataclass(frozen=True, slots=True)
class PlannedCampaign:
    """Plan as it was written, and the uncertainty that it will give."""

    checked: CheckedPlan
    forecast: Forecast
    placement: Placement
    seed: int
    refusals: Refusals | None = None
    """Refusals by the space; None without one."""
    lines_mm: tuple[float, float, float] | None = None
    """Validation lines that would fit, where those of campaign.yaml are too long; else None."""


def plan(
    campaign: Campaign,
    options: PlanOptions | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> PlannedCampaign:
    """Make, check and write a plan; an older one is kept.

    `tell` is given words on the progress. Raise `OptionsInvalid`, `PlanInvalid` or `WriteFailed`.
    """
    options = options or PlanOptions()
    planned = _make_and_check(campaign, options, tell)
    with campaign.held():
        shots = planned.checked.shots
        write_beside_older(campaign.plan_path, shots, campaign.robot.mechanism)
    return planned


def planned_model(campaign: Campaign, fix: tuple[str, ...] = ()) -> ErrorModel:
    """Return the model of all sources of error that the shots of a plan will be fitted with."""
    how = identification_options(campaign, IdentificationOptions(fix=fix))
    return error_model(campaign.robot.kinematics, None, how)


def _make_and_check(
    campaign: Campaign, options: PlanOptions, tell: Callable[[str], None]
) -> PlannedCampaign:
    """Make and check a plan; nothing is written."""
    config, robot, model = campaign.config, campaign.robot, planned_model(campaign, options.fix)
    until_mm = None if options.until is None else read_goal(options.until)
    most = MOST_SHOTS if options.shots is None and until_mm is not None else options.shots
    request = OptimalRequest(
        plan=campaign.plan_request(most),
        model=model,
        uncertainty=campaign.instrument,
        until_mm=until_mm,
    )
    asked = Placement.OPTIMAL if until_mm is not None else options.placement
    placement = asked or Placement(config.plan.placement)
    seed = config.plan.seed if options.seed is None else options.seed
    rng = np.random.default_rng(seed)
    tell("choosing poses and their order")
    if placement is Placement.OPTIMAL:
        shots = make_optimal_plan(robot, campaign.view, request, rng)
    else:
        shots = make_plan(robot, campaign.view, request.plan, rng)
    checked = campaign.checked_plan(with_nests(shots, config.nests, config.known_lengths), tell)
    tell("predicting the uncertainty that the shots will give")
    judged = judged_positions(model, campaign.robot_model, poses_of(shots))
    tracker_mm = np.array(campaign.view.tracker_mm)
    return PlannedCampaign(
        checked,
        forecast(shots, model, tracker_mm, campaign.instrument, judged),
        placement,
        seed,
        _refusals(campaign, rng),
        _fitting_lines_mm(campaign),
    )


def _fitting_lines_mm(campaign: Campaign) -> tuple[float, float, float] | None:
    robot, asked = campaign.robot, campaign.config.validation.line_lengths_mm
    fitting = fitting_lines(robot.kinematics, robot.limits, campaign.centre, asked, campaign.space)
    pairs = zip(fitting, asked, strict=True)
    return fitting if any(mm < SHORTEST_PART * wanted for mm, wanted in pairs) else None


def _refusals(campaign: Campaign, rng: np.random.Generator) -> Refusals | None:
    if not campaign.space.is_restricted:
        return None
    try:
        return campaign.region.refusals(REFUSALS_SAMPLE, rng)
    except WorkspaceTooSmall:
        return None
