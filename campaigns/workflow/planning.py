"""Planning of a campaign: poses chosen, checked and written, and what they will tell."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from campaigns.campaign import Campaign
from campaigns.design.pose_sampling import WorkspaceTooSmall
from campaigns.design.restricted_space import Refusals
from campaigns.errors import OptionsInvalid, PlanInvalid
from campaigns.estimation.estimators import MAY_HAVE_GEARS, Estimator, Model
from campaigns.estimation.information import Uncertainty
from campaigns.measuring.stopping_rule import read_goal
from campaigns.options import PlanOptions
from campaigns.planning.optimal_plan import MOST_SHOTS, OptimalRequest, make_optimal_plan
from campaigns.planning.plan_check import CheckedPlan
from campaigns.planning.plan_file import write_beside_older
from campaigns.planning.plans import Placement, make_plan, with_nests
from campaigns.planning.predicted_uncertainty import (
    EstimationSetup,
    Forecast,
    judged_positions,
    plan_forecast,
)
from campaigns.planning.validation_plan import SHORTEST_PART, fitting_lines
from campaigns.workflow.work import free_parameters

REFUSALS_SAMPLE = 2000
"""Poses by which it is told how much the space refuses."""


@dataclass(frozen=True, slots=True)
class PlannedCampaign:
    """Plan as it was written, and what it will tell."""

    checked: CheckedPlan
    forecast: Forecast
    curve: tuple[Forecast, ...]
    """Forecasts of other numbers of shots; empty where shots were not chosen."""
    placement: Placement
    seed: int
    refusals: Refusals | None = None
    """Refusals by the space; None without one."""
    model: Model = Model.STANDARD
    note: str = ""
    """Why it is not for the full model, where no other was asked for."""
    lines_mm: tuple[float, float, float] | None = None
    """Validation lines that would fit, where those of campaign.yaml are too long; else None."""


def plan(
    campaign: Campaign,
    options: PlanOptions | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> PlannedCampaign:
    """Make, check and write a plan; an older one is kept.

    For the full model unless told otherwise, or for the standard one where that takes more shots.
    `tell` hears what is done. Raises `OptionsInvalid`, `PlanInvalid` or `WriteFailed`.
    """
    options = options or PlanOptions()
    planned = _largest(campaign, options, tell)
    with campaign.held():
        shots = planned.checked.shots
        write_beside_older(campaign.plan_path, shots, campaign.robot.mechanism)
    return planned


def _largest(
    campaign: Campaign, options: PlanOptions, tell: Callable[[str], None]
) -> PlannedCampaign:
    """Plan for the model asked for, or else for the larger one that its shots can tell."""
    if options.model is not None:
        return _made(campaign, options, options.model, tell)
    try:
        planned, why = _made(campaign, options, Model.FULL, tell), "the shots are too few"
    except PlanInvalid as error:
        planned, why = None, error.problem
    if planned is not None and planned.forecast.predicted.full_rank:
        return planned
    smaller = _made(campaign, options, Model.STANDARD, tell)
    if not smaller.forecast.predicted.full_rank:
        return planned or smaller
    return replace(smaller, note=f"planned for the standard model, not the full one: {why}")


def _made(
    campaign: Campaign, options: PlanOptions, model: Model, tell: Callable[[str], None]
) -> PlannedCampaign:
    """Plan for a model, checked; nothing is written."""
    placement, request = _settled(campaign, options, model)
    seed = campaign.config.plan.seed if options.seed is None else options.seed
    rng = np.random.default_rng(seed)
    curve: tuple[tuple[int, Uncertainty], ...] = ()
    tell(f"choosing poses and their order, for the {model} model")
    if placement is Placement.OPTIMAL:
        shots, curve = make_optimal_plan(campaign.robot, campaign.view, request, rng)
    else:
        shots = make_plan(campaign.robot, campaign.view, request.plan, rng)
    named = None if model is Model.STANDARD else model  # such a plan is as plans always were
    shots, config = tuple(replace(shot, model=named) for shot in shots), campaign.config
    measured = with_nests(shots, config.nests, config.known_lengths)
    checked = campaign.checked_plan(measured, tell)
    tell("predicting what the shots will tell")
    robot, view, space = campaign.robot, campaign.view, campaign.space
    sample = judged_positions(robot, campaign.centre, space, request.free, shots)
    setup = EstimationSetup(Estimator.POINTS, request.free, request.uncertainty)
    forecast = plan_forecast(shots, robot.kinematics, np.array(view.tracker_mm), setup, sample)
    return PlannedCampaign(
        checked,
        forecast,
        tuple(Forecast.of(count, predicted, sample) for count, predicted in curve),
        placement,
        seed,
        _refusals(campaign, rng),
        model,
        lines_mm=_fitting_lines_mm(campaign),
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


def _settled(
    campaign: Campaign, options: PlanOptions, model: Model
) -> tuple[Placement, OptimalRequest]:
    """Options before settings; raises `OptionsInvalid`."""
    free = free_parameters(campaign, options, model)
    lengths = campaign.robot.parameters.space.of_unit("mm", free)
    until_mm = None if options.until is None else _goal_mm(options.until, lengths)
    most = MOST_SHOTS if options.shots is None and until_mm is not None else options.shots
    request = OptimalRequest(
        plan=replace(campaign.plan_request(most), tells_backlash=model in MAY_HAVE_GEARS),
        uncertainty=campaign.instrument,
        free=free,
        until_mm=until_mm,
    )
    by_options = options.placement if options.until is None else Placement.OPTIMAL
    return by_options or Placement(campaign.config.plan.placement), request


def _goal_mm(text: str, lengths: tuple[str, ...]) -> float:
    if not lengths:
        raise OptionsInvalid(
            "--until is a goal for lengths, but --fix leaves no length to find",
            remedy="give --shots instead, or fix fewer",
        )
    return read_goal(text).std_mm
