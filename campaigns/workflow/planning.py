"""Planning of a campaign: poses chosen, checked and written, and what they will tell."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from campaigns.campaign import Campaign
from campaigns.controllers.export import compensated_robot, latest_identification
from campaigns.design.pose_sampling import WorkspaceTooSmall
from campaigns.design.restricted_space import Refusals
from campaigns.errors import OptionsInvalid, PlanInvalid
from campaigns.estimation.estimators import MAY_HAVE_GEARS, Estimator, Model
from campaigns.estimation.information import Uncertainty
from campaigns.measuring.stopping_rule import read_goal
from campaigns.options import PlanOptions
from campaigns.planning.optimal_plan import (
    CANDIDATES,
    MOST_SHOTS,
    OptimalRequest,
    make_optimal_plan,
)
from campaigns.planning.plan_check import CheckedPlan
from campaigns.planning.plan_file import PlannedShot, plan_model, write_beside_older
from campaigns.planning.plans import (
    TRACKER_CLEARANCE_MM,
    Placement,
    commanded_to,
    make_plan,
    region_of,
    tracker_clearance_mm,
    with_nests,
)
from campaigns.planning.predicted_uncertainty import (
    EstimationSetup,
    Forecast,
    judged_positions,
    plan_forecast,
)
from campaigns.planning.stands import Stand, compare_stands, places_about
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
    estimator: Estimator
    placement: Placement
    criterion: str | None
    """None where shots were not chosen."""
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
    `tell` hears what is done. Raises `OptionsInvalid`, `PlanInvalid` or `WriteFailed`; for the
    identified robot `ShotsMissing` where nothing was identified, and `VerdictBad` where that did
    not pass.
    """
    options = options or PlanOptions()
    planned = _largest(campaign, options, tell)
    with campaign.held():
        shots = planned.checked.shots
        write_beside_older(campaign.plan_path, shots, campaign.robot.mechanism)
    return planned


def where_tracker(
    campaign: Campaign, shots: Sequence[PlannedShot], options: PlanOptions | None = None
) -> tuple[Stand, ...]:
    """Stands of the tracker about the robot, at the height that campaign.yaml has, for a plan.

    Those in the robot are left out. Raises `OptionsInvalid` and `PlanInvalid`.
    """
    _, request = _settled(campaign, options or PlanOptions(), plan_model(shots))
    robot, tracker, space = campaign.robot, campaign.config.tracker, campaign.space
    centre_mm = campaign.centre[:3]
    places = places_about(centre_mm, tracker.place_mm[2])
    clear = tracker_clearance_mm(campaign.region, places) > TRACKER_CLEARANCE_MM
    sample = judged_positions(robot, campaign.centre, space, request.free, shots)
    return compare_stands(
        shots,
        robot.kinematics,
        campaign.view,
        places[clear],
        tracker.reflector_facing,
        space,
        EstimationSetup(request.estimator, request.free, request.uncertainty),
        sample,
        centre_mm,
    )


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
    """Plan for a model, checked; nothing is written.

    Where it is for the identified robot, its poses are those of the nominal one at the same joints:
    runs and controllers take a plan by the nominal robot, and command joints.
    """
    nominal = campaign
    if options.after_identify:
        campaign, options = _as_identified(nominal, options)
    placement, request = _settled(campaign, options, model)
    if campaign is not nominal:
        robot, wanted = nominal.robot, request.plan
        own = robot.kinematics, robot.limits, nominal.view, wanted.centre, wanted.space
        request = replace(request, plan=replace(wanted, commanded=region_of(*own)))
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
    commanded = shots if campaign is nominal else commanded_to(shots, nominal.robot.kinematics)
    measured = with_nests(commanded, config.nests, config.known_lengths)
    checked = nominal.checked_plan(measured, tell)
    tell("predicting what the shots will tell")
    robot, view, space = campaign.robot, campaign.view, campaign.space
    sample = judged_positions(robot, campaign.centre, space, request.free, shots)
    setup = EstimationSetup(request.estimator, request.free, request.uncertainty)
    forecast = plan_forecast(shots, robot.kinematics, np.array(view.tracker_mm), setup, sample)
    return PlannedCampaign(
        checked,
        forecast,
        tuple(Forecast.of(count, predicted, sample) for count, predicted in curve),
        request.estimator,
        placement,
        request.criterion if placement is Placement.OPTIMAL else None,
        seed,
        _refusals(campaign, rng),
        model,
        lines_mm=_fitting_lines_mm(campaign),
    )


def _as_identified(campaign: Campaign, options: PlanOptions) -> tuple[Campaign, PlanOptions]:
    """The same with the robot as it was identified last, and options with its own scatter.

    Identified anew from the plan's shots alone, it is not known beside them: no prior is assumed.
    """
    with campaign.journal_reader() as journal:
        found = latest_identification(journal)
    robot = compensated_robot(campaign.config.name, campaign.nominal, found)
    scatter = found.robot_scatter
    scatter_mm = options.scatter_mm or (scatter.point_mm if scatter else 0.0)
    return replace(campaign, nominal=robot), replace(options, scatter_mm=scatter_mm)


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
        plan=replace(
            campaign.plan_request(most),
            tells_backlash=model in MAY_HAVE_GEARS,
            inaccurate=options.inaccurate,
        ),
        uncertainty=replace(campaign.instrument, robot_scatter_mm=options.scatter_mm),
        free=free,
        estimator=options.estimator,
        criterion=options.criterion or "I",
        until_mm=until_mm,
        candidates=options.candidates or CANDIDATES,
    )
    by_options = Placement.OPTIMAL if any(options.choosing) else options.placement
    return by_options or Placement(campaign.config.plan.placement), request


def _goal_mm(text: str, lengths: tuple[str, ...]) -> float:
    if not lengths:
        raise OptionsInvalid(
            "--until is a goal for lengths, but --fix leaves no length to find",
            remedy="give --shots instead, or fix fewer",
        )
    return read_goal(text).std_mm
