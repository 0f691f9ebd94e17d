"""From a campaign's files to what the work needs: view, mechanism, plan request, pace."""

import numpy as np

from app.folder import Campaign
from campaigns.numerics.geometry import Geometry
from campaigns.plan_check import CheckedPlan, Pace, check_plan
from campaigns.plan_file import PlannedShot
from campaigns.planning import PlanRequest, View, numeric_geometry, numeric_limits, pose_row
from campaigns.ways import Mechanism
from drivers.values import Pose, Vector3

FULL_JOINT_SPEED_RAD_S = float(np.radians(180.0))
"""Only for estimates of time: what a fast parallel robot's joints do at 100 %."""


def centre_of(campaign: Campaign) -> Pose:
    """The workspace's centre: where drift is watched and detours lead."""
    return Pose(*campaign.config.validation.centre_mm, theta_rad=0.0)


def view_of(campaign: Campaign) -> View:
    """How the tracker sees the reflector."""
    tracker = campaign.config.tracker
    centre = campaign.config.validation.centre_mm
    facing = tracker.reflector_facing or _towards(centre, tracker.place_mm)
    return View(tracker.place_mm, facing, tracker.acceptance_rad)


def mechanism_of(campaign: Campaign, geometry: Geometry) -> Mechanism:
    """What ways are checked against, with the geometry that holds now."""
    limits = numeric_limits(campaign.nominal.robot)
    return Mechanism(geometry, limits, pose_row(centre_of(campaign)))


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


def _towards(from_mm: Vector3, to_mm: Vector3) -> Vector3:
    x, y, z = (b - a for a, b in zip(from_mm, to_mm, strict=True))
    return x, y, z
