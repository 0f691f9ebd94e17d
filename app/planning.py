"""From options and campaign.yaml to a plan in the campaign's folder, and what it will tell."""

from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

from app.exits import UsageInvalid
from campaigns.estimation.estimators import Estimator

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.random import Generator

    from app.folder import Campaign
    from app.plan_precision_text import PlanForecast
    from campaigns.arrays import Array
    from campaigns.design.criteria import CriterionName
    from campaigns.design.pose_sampling import FeasibleRegion
    from campaigns.planning.optimal_plan import OptimalRequest
    from campaigns.planning.plan_check import CheckedPlan
    from campaigns.planning.plan_file import PlannedShot
    from campaigns.planning.predicted_precision import PredictedPrecision

WORKSPACE_SEED = 1
"""Positions are judged at the same places for every plan of a robot."""


class Placement(Enum):
    """Where poses are placed; the value is the word on the command line and in campaign.yaml."""

    BOUNDARY = "boundary"
    OPTIMAL = "optimal"


@dataclass(frozen=True, slots=True)
class PlanOptions:
    """What the options say; None where they say nothing. Raises `UsageInvalid`."""

    shots: int | None = None
    placement: Placement | None = None
    until: str | None = None
    criterion: "CriterionName | None" = None
    candidates: int | None = None
    estimator: Estimator = Estimator.POINTS
    free: tuple[str, ...] = ()
    fix: tuple[str, ...] = ()
    seed: int | None = None

    def __post_init__(self) -> None:
        if self.shots is not None and self.shots % 2:
            raise UsageInvalid(
                f"--shots is {self.shots}, but two make a pair", remedy="give an even number"
            )
        if self.placement is Placement.BOUNDARY and self.choosing:
            option = self.choosing[0]
            raise UsageInvalid(
                f"{option} is for shots that are chosen, but --placement boundary draws them",
                remedy=f"give --placement optimal, or leave {option} out",
            )

    @property
    def choosing(self) -> tuple[str, ...]:
        """The options given that only choosing can heed."""
        options = {
            "--until": self.until,
            "--criterion": self.criterion,
            "--candidates": self.candidates,
        }
        return tuple(option for option, value in options.items() if value is not None)


@dataclass(frozen=True, slots=True)
class PlanSettings:
    """What options and settings say together."""

    placement: Placement
    request: "OptimalRequest"
    """Where shots are not chosen, only what they are for."""
    seed: int


def make(
    campaign: "Campaign", asked: PlanOptions | None = None
) -> "tuple[CheckedPlan, PlanForecast]":
    """Make, check and write a plan; an older one is kept.

    Raises `UsageInvalid`, `GoalInvalid`, `SelectionInvalid`, `PlanInvalid` or `WriteFailed`.
    """
    import numpy as np

    from app.folder import held
    from app.work_builders import checked_plan

    wanted = settled_plan(campaign, asked or PlanOptions())
    shots, curve = _placed(campaign, wanted, np.random.default_rng(wanted.seed))
    checked = checked_plan(campaign, shots)
    forecast = _forecast(campaign, wanted, checked.shots, curve)
    with held(campaign):
        _write_beside_older(campaign.plan_path, checked.shots)
    return checked, forecast


def settled_plan(campaign: "Campaign", asked: PlanOptions) -> PlanSettings:
    """Options before settings; raises `GoalInvalid`, `SelectionInvalid` or `UsageInvalid`."""
    from app.work_builders import plan_request_of, tracker_uncertainty_of
    from campaigns.identification.parameter_selection import select_parameters
    from campaigns.mechanisms.geometry import GEOMETRY_NAMES
    from campaigns.planning.optimal_plan import CANDIDATES, MOST_SHOTS, OptimalRequest

    free = select_parameters(asked.free, asked.fix, names=GEOMETRY_NAMES).free
    until_mm = None if asked.until is None else _goal_mm(asked.until, free)
    most = MOST_SHOTS if asked.shots is None and until_mm is not None else asked.shots
    request = OptimalRequest(
        plan_request_of(campaign, most),
        tracker_uncertainty_of(campaign.config),
        asked.estimator,
        asked.criterion or "I",
        free,
        until_mm,
        asked.candidates or CANDIDATES,
    )
    settings = campaign.config.plan
    by_options = Placement.OPTIMAL if asked.choosing else asked.placement
    seed = settings.seed if asked.seed is None else asked.seed
    return PlanSettings(by_options or Placement(settings.placement), request, seed)


def _goal_mm(text: str, free: tuple[str, ...]) -> float:
    from campaigns.measuring.stopping_rule import read_goal

    if not any(name.endswith("_mm") for name in free):
        raise UsageInvalid(
            "--until is a goal for lengths, but --fix leaves no length to find",
            remedy="give --shots instead, or fix fewer",
        )
    return read_goal(text).std_mm


def _placed(
    campaign: "Campaign", wanted: PlanSettings, rng: "Generator"
) -> "tuple[tuple[PlannedShot, ...], tuple[PredictedPrecision, ...]]":
    """The shots, and what other numbers of them would tell."""
    from app.work_builders import view_of
    from campaigns.planning.optimal_plan import make_optimal_plan
    from campaigns.planning.plans import make_plan

    robot, view = campaign.nominal.robot, view_of(campaign)
    if wanted.placement is Placement.BOUNDARY:
        return make_plan(robot, view, wanted.request.plan, rng), ()
    made = make_optimal_plan(robot, view, wanted.request, rng)
    return made.shots, made.curve


def _forecast(
    campaign: "Campaign",
    wanted: PlanSettings,
    shots: "tuple[PlannedShot, ...]",
    curve: "tuple[PredictedPrecision, ...]",
) -> "PlanForecast":
    """Raises `PlanInvalid` for parameters that nothing could tell apart."""
    from app.plan_precision_text import PlanForecast
    from campaigns.planning.predicted_precision import (
        EstimationSetup,
        PrecisionCurvePoint,
        predict_precision,
        workspace_jacobian,
    )

    region, request = _region(campaign), wanted.request
    judged_at = workspace_jacobian(region.geometry, request.free, _workspace(region, shots))
    means = EstimationSetup(request.estimator, request.free, request.uncertainty)
    return PlanForecast(
        predict_precision(shots, region.geometry, region.view_from_mm, means, judged_at),
        tuple(PrecisionCurvePoint.of(at, judged_at) for at in curve),
        request.estimator,
        wanted.placement.value,
        request.criterion if wanted.placement is Placement.OPTIMAL else None,
        wanted.seed,
    )


def _region(campaign: "Campaign") -> "FeasibleRegion":
    from app.work_builders import centre_of, view_of
    from campaigns.planning.plans import region_of, with_reserve
    from campaigns.robots.robot import numeric_geometry, numeric_limits

    robot = campaign.nominal.robot
    limits = with_reserve(numeric_limits(robot))
    return region_of(numeric_geometry(robot), limits, view_of(campaign), centre_of(campaign))


def _workspace(region: "FeasibleRegion", shots: "tuple[PlannedShot, ...]") -> "Array":
    """Where positions are judged, (N, 4): at the plan's own poses where hardly any others are."""
    import numpy as np

    from campaigns.design.pose_sampling import WorkspaceTooSmall, workspace_poses
    from campaigns.planning.plans import poses_of
    from campaigns.planning.predicted_precision import WORKSPACE_SAMPLE

    rng = np.random.default_rng(WORKSPACE_SEED)
    try:
        return workspace_poses(region.geometry, region.limits, region.centre, WORKSPACE_SAMPLE, rng)
    except WorkspaceTooSmall:
        return poses_of(shots)


def _write_beside_older(path: "Path", shots: "tuple[PlannedShot, ...]") -> None:
    """Write a plan; an older one is kept under the first free number, or stays if that fails."""
    from campaigns.errors import CampaignError
    from campaigns.planning.plan_file import write_plan

    older = _moved_aside(path)
    try:
        write_plan(path, shots)
    except CampaignError:
        if older is not None:
            older.rename(path)
        raise


def _moved_aside(path: "Path") -> "Path | None":
    from campaigns.errors import WriteFailed

    if not path.exists():
        return None
    number = 1
    while (older := path.with_name(f"plan-older-{number}.csv")).exists():
        number += 1
    try:
        return path.rename(older)
    except OSError as error:
        raise WriteFailed(
            f"{path}: cannot be renamed to {older.name} ({error.strerror})",
            remedy="check that this user may write the folder",
        ) from error
