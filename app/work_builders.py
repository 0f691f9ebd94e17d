"""How the tracker sees the robot, as the campaign's settings say. Light: no engine is imported."""

from collections.abc import Mapping

import numpy as np

from app.folder import Campaign
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.journal.records import Stage
from campaigns.measuring.rules import gate_rules, motion_rules
from campaigns.measuring.session import Work
from campaigns.mechanisms.geometry import Geometry
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_check import CheckedPlan, Pace, check_plan
from campaigns.planning.plan_file import PlannedShot, plan_digest, read_plan
from campaigns.planning.plans import PlanRequest, View
from campaigns.planning.steps import Step, joint_steps
from campaigns.planning.validation_plan import Reachable, validation_steps
from campaigns.robots.robot import RobotFile, numeric_geometry, numeric_limits, pose_row
from campaigns.settings.config import CampaignConfig
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Pose, Vector3


def centre_of(campaign: Campaign) -> Pose:
    """The workspace's centre: where drift is watched and detours lead."""
    return Pose(*campaign.config.validation.centre_mm, theta_rad=0.0)


def view_of(campaign: Campaign) -> View:
    """How the tracker sees the reflector."""
    tracker = campaign.config.tracker
    centre = campaign.config.validation.centre_mm
    facing = tracker.reflector_facing or _towards(centre, tracker.place_mm)
    return View(tracker.place_mm, facing, tracker.acceptance_rad)


def tracker_uncertainty_of(config: CampaignConfig) -> TrackerUncertainty:
    """The tracker's standard uncertainty, by the limits that campaign.yaml has of its data sheet.

    For plans, and for shots of which the tracker itself stated none.
    """
    limits = config.tracker.uncertainty
    return TrackerUncertainty.of_limits(
        limits.along_um, limits.along_um_per_m, limits.across_um, limits.across_um_per_m
    )


def _towards(from_mm: Vector3, to_mm: Vector3) -> Vector3:
    x, y, z = (b - a for a, b in zip(from_mm, to_mm, strict=True))
    return x, y, z


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
        RobotModel(geometry, limits, pose_row(centre_of(campaign))),
        motion_rules(campaign.config),
        gate_rules(campaign.config),
        instrument=tracker_uncertainty_of(campaign.config),
    )


def _unseen_shots(campaign: Campaign) -> list[PlannedShot]:
    shots = read_plan(campaign.plan_path)
    return [shot for shot in shots if shot.purpose is ShotSet.VALIDATION]
