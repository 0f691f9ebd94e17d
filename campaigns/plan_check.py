"""Judges a plan, made or edited, before anything moves."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.errors import PlanInvalid
from campaigns.numerics.forward import forward
from campaigns.numerics.geometry import Array, Geometry
from campaigns.numerics.paths import path_fault, route
from campaigns.numerics.placement import incidence_rad, travel_rad
from campaigns.numerics.reach import Limits, explain, reach
from campaigns.plan_file import PlannedShot
from campaigns.planning import View, joints_of, pose_row, poses_of
from drivers.values import Pose

AGREEMENT_MM = 0.01
AGREEMENT_RAD = np.radians(0.01)
"""How far a row's pose may be from the pose of its joints."""
TOLERANCE_RAD = 1e-9
FAULTS_NAMED = 5


@dataclass(frozen=True, slots=True)
class Pace:
    """What a shot takes besides the way."""

    joint_speed_rad_s: float
    settle_s: float
    measure_s: float


@dataclass(frozen=True, slots=True)
class CheckedPlan:
    """A plan that can be run, and how."""

    shots: tuple[PlannedShot, ...]
    detours: int
    """How many ways between shots are not straight because that would not be safe."""
    seconds: float
    travel_rad: float


def check_plan(
    shots: Sequence[PlannedShot],
    geometry: Geometry,
    limits: Limits,
    view: View,
    centre: Pose,
    pace: Pace,
) -> CheckedPlan:
    """Check reach, limits, swing, singularity, the tracker's view and every way between shots.

    Raises `PlanInvalid` naming each shot at fault with value and limit.
    """
    faults = _pose_faults(shots, geometry, limits) + _view_faults(shots, view)
    if not faults:
        faults = _agreement_faults(shots, geometry)
    if faults:
        raise PlanInvalid(
            _listed(faults), remedy="correct plan.csv, or plan anew with `pkmcal plan`"
        )
    joints = joints_of(shots)
    detours, travel, faults = _ways(shots, joints, pose_row(centre), geometry, limits)
    if faults:
        raise PlanInvalid(_listed(faults), remedy="move one of the two poses, or plan anew")
    seconds = travel / pace.joint_speed_rad_s + len(shots) * (pace.settle_s + pace.measure_s)
    return CheckedPlan(tuple(shots), detours, seconds, travel)


def _ways(
    shots: Sequence[PlannedShot], joints: Array, centre: Array, geometry: Geometry, limits: Limits
) -> tuple[int, float, list[str]]:
    detours, travel, faults = 0, 0.0, []
    for row in range(len(joints) - 1):
        way = route(geometry, limits, joints[row], joints[row + 1], centre)
        if way is None:
            fault = path_fault(geometry, limits, joints[row], joints[row + 1])
            why = fault.reason if fault else "every way is blocked"
            faults.append(
                f"no safe way from shot {shots[row].shot} to {shots[row + 1].shot}: {why}"
            )
            continue
        detours += len(way) > 1
        travel += float(
            sum(travel_rad(a, b) for a, b in zip([joints[row], *way], way, strict=False))
        )
    return detours, travel, faults


def _pose_faults(shots: Sequence[PlannedShot], geometry: Geometry, limits: Limits) -> list[str]:
    poses = poses_of(shots)
    judged = reach(geometry, _tolerant(limits), poses)
    return [
        f"shot {shots[row].shot}: {'; '.join(explain(limits, judged, row, float(poses[row, 3])))}"
        for row in np.flatnonzero(~judged.feasible).tolist()
    ]


def _tolerant(limits: Limits) -> Limits:
    """Limits that a pose exactly on them keeps."""
    (low, high), (left, right) = limits.joint_rad, limits.theta_rad
    return Limits(
        (low - TOLERANCE_RAD, high + TOLERANCE_RAD),
        (left - TOLERANCE_RAD, right + TOLERANCE_RAD),
        limits.forearm_swing_rad + TOLERANCE_RAD,
        limits.singularity_margin,
        limits.elbow_margin,
    )


def _view_faults(shots: Sequence[PlannedShot], view: View) -> list[str]:
    facing = np.array(view.facing) / np.linalg.norm(view.facing)
    angle = incidence_rad(poses_of(shots)[:, :3], np.array(view.tracker_mm), facing)
    return [
        f"shot {shots[row].shot}: reflector turned {np.degrees(angle[row]):.1f}° from the tracker, "
        f"limit {np.degrees(view.acceptance_rad):g}°"
        for row in np.flatnonzero(angle > view.acceptance_rad).tolist()
    ]


def _agreement_faults(shots: Sequence[PlannedShot], geometry: Geometry) -> list[str]:
    poses, joints = poses_of(shots), joints_of(shots)
    away = np.abs(forward(geometry, joints, poses).values - poses)
    wrong = ~((away[:, :3].max(axis=1) <= AGREEMENT_MM) & (away[:, 3] <= AGREEMENT_RAD))
    return [
        f"shot {shots[row].shot}: its joints lead {away[row, :3].max():.3g} mm away from its pose "
        f"(limit {AGREEMENT_MM} mm)"
        for row in np.flatnonzero(wrong).tolist()
    ]


def _listed(faults: list[str]) -> str:
    more = f" … and {len(faults) - FAULTS_NAMED} more" if len(faults) > FAULTS_NAMED else ""
    return " | ".join(faults[:FAULTS_NAMED]) + more
