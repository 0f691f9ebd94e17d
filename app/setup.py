"""From a campaign's files to what the work needs: view, plan request, pace, and the work itself."""

from collections.abc import Mapping

import numpy as np

from app.folder import Campaign
from app.view import centre_of, tracker_uncertainty_of, view_of
from campaigns.journal.records import Stage
from campaigns.measuring.session import Work
from campaigns.measuring.steps import Step, joint_steps
from campaigns.numerics.geometry import Geometry
from campaigns.planning.plan_check import CheckedPlan, Pace, check_plan
from campaigns.planning.plan_file import PlannedShot, plan_digest, read_plan
from campaigns.planning.plans import PlanRequest
from campaigns.planning.rules import gate_rules, motion_rules
from campaigns.planning.ways import Mechanism
from campaigns.robots.arrays import numeric_geometry, numeric_limits, pose_row
from campaigns.robots.robot import RobotFile
from campaigns.shot_sets import ShotSet
from campaigns.validation.plan import Reachable, validation_steps

FULL_JOINT_SPEED_RAD_S = float(np.radians(180.0))
"""Only for estimates of time: what a fast parallel robot's joints do at 100 %."""


def plan_request_of(campaign: Campaign, shots: int | None) -> PlanRequest:
    """What the campaign's plan shall hold."""
    plan = campaign.config.plan
    return PlanRequest(
        shots or plan.shots, plan.validation_pairs, plan.drift_shots, centre_of(campaign)
    )


def pace_of(campaign: Campaign) -> Pace:
    """What a shot takes besides the way."""
    config = campaign.config
    speed = FULL_JOINT_SPEED_RAD_S * config.controller.speed_percent / 100.0
    return Pace(speed, config.settle.time_s, config.tracker.measuring_time_s)


def checked_plan(campaign: Campaign, shots: tuple[PlannedShot, ...]) -> CheckedPlan:
    """The plan, if the nominal robot can run it; raises `PlanInvalid`."""
    robot = campaign.nominal.robot
    return check_plan(
        shots,
        numeric_geometry(robot),
        numeric_limits(robot),
        view_of(campaign),
        centre_of(campaign),
        pace_of(campaign),
    )


def plan_work(campaign: Campaign, checked: CheckedPlan) -> Work:
    """The plan as work for the engine; the shots are commanded by joint angles."""
    robot = campaign.nominal.robot
    steps = joint_steps(checked.shots)
    return _work(campaign, "run", steps, numeric_geometry(robot), robot.digest())


def validation_work(
    campaign: Campaign, stage: Stage, sets: frozenset[ShotSet], active: Mapping[str, float]
) -> tuple[Work, tuple[str, ...]]:
    """Tests as work for the engine, and what had to be shortened or left out.

    Planned with the geometry that is active in the controller, which takes the pose commands.
    """
    nominal = campaign.nominal.robot
    geometry = Geometry.from_flat(active)
    planned = validation_steps(
        campaign.config.validation,
        _unseen_shots(campaign) if ShotSet.VALIDATION in sets else [],
        Reachable(geometry, numeric_limits(nominal)),
        sets,
        np.random.default_rng(campaign.config.plan.seed),
    )
    digest = RobotFile.from_flat(active, name="active", limits=nominal.limits).digest()
    return _work(campaign, stage, planned.steps, geometry, digest), planned.notes


def _work(
    campaign: Campaign, stage: Stage, steps: tuple[Step, ...], geometry: Geometry, digest: str
) -> Work:
    limits = numeric_limits(campaign.nominal.robot)
    return Work(
        stage,
        steps,
        plan_digest([step.planned for step in steps]),
        digest,
        campaign.config.model_dump(mode="json"),
        Mechanism(geometry, limits, pose_row(centre_of(campaign))),
        motion_rules(campaign.config),
        gate_rules(campaign.config),
        instrument=tracker_uncertainty_of(campaign.config),
    )


def _unseen_shots(campaign: Campaign) -> list[PlannedShot]:
    shots = read_plan(campaign.plan_path)
    return [shot for shot in shots if shot.purpose is ShotSet.VALIDATION]
