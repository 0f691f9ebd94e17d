"""Check of a plan, made or edited, before anything moves."""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array
from campaigns.design.pose_sampling import incidence_rad
from campaigns.design.restricted_space import RestrictedSpace
from campaigns.errors import PlanInvalid
from campaigns.kinematics.feasibility import Feasibility, Limits
from campaigns.kinematics.mechanism import Kinematics
from campaigns.planning.paths import RobotModel, check_paths
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import View, poses_of
from campaigns.robots.robot import pose_row
from campaigns.settings.sections import KnownLengthConfig, bar_of
from campaigns.shots.shot_sets import ShotSet

AGREEMENT_RAD = float(np.radians(0.01))
"""Largest distance of a row's joints from its pose's: of cranks, or what compares."""
TOLERANCE_RAD = 1e-9
FAULTS_NAMED = 5


@dataclass(frozen=True, slots=True)
class Pace:
    """Time that a shot takes besides the way."""

    joint_speed_rad_s: float
    settle_s: float
    measure_s: float

    def seconds(self, shots: int, travel_rad: float) -> float:
        """Return the time of shots and the ways between them."""
        return travel_rad / self.joint_speed_rad_s + shots * (self.settle_s + self.measure_s)


@dataclass(frozen=True, slots=True)
class PlanLimits:
    """What a plan is checked by."""

    robot: RobotModel
    view: View
    pace: Pace
    nests: Collection[str] = ()
    known_lengths: Sequence[KnownLengthConfig] = ()


@dataclass(frozen=True, slots=True)
class CheckedPlan:
    """A plan that can be run, and how."""

    shots: tuple[PlannedShot, ...]
    detours: int
    """Number of ways between shots that are not straight because that would not be safe."""
    seconds: float


def check_plan(
    shots: Sequence[PlannedShot], limits: PlanLimits, tell: Callable[[str], None] = lambda _: None
) -> CheckedPlan:
    """Check reach, limits, swing, singularity, space, the tracker's view, every way between shots.

    Nests and known lengths are checked too; `tell` is given words on the progress. Raise
    `PlanInvalid` naming the shots at fault with value and limit.
    """
    robot = limits.robot
    refuse(
        [
            *_pose_faults(shots, robot.kinematics, robot.limits),
            *_space_faults(shots, robot.space),
            *_view_faults(shots, limits.view),
            *_drift_faults(shots),
            *_nest_faults(shots, limits.nests, limits.known_lengths),
        ],
        remedy="correct plan.csv, or make a new plan with `pkmcal plan DIR`",
    )
    tell(f"checking the {len(shots) - 1} ways between shots")
    paths = check_paths([(f"shot {shot.shot}", np.array(shot.joints)) for shot in shots], robot)
    refuse(
        paths.faults, remedy="move one of the two poses, or make a new plan with `pkmcal plan DIR`"
    )
    seconds = limits.pace.seconds(len(shots), paths.travel_rad)
    return CheckedPlan(tuple(shots), paths.detours, seconds)


def refuse(faults: Sequence[str], *, remedy: str) -> None:
    """Raise `PlanInvalid` with the first faults, if there are any."""
    if not faults:
        return
    more = f" … and {len(faults) - FAULTS_NAMED} more" if len(faults) > FAULTS_NAMED else ""
    raise PlanInvalid(" | ".join(faults[:FAULTS_NAMED]) + more, remedy=remedy)


def view_fault(point_mm: Array, view: View) -> str:
    """Return why a point (3,) in the base frame cannot be seen; empty if it can."""
    facing = np.array(view.facing) / np.linalg.norm(view.facing)
    (angle,) = incidence_rad(point_mm[None], np.array(view.tracker_mm), facing)
    if angle <= view.acceptance_rad:
        return ""
    return (
        f"reflector turned {np.degrees(angle):.1f}° from the tracker, "
        f"limit {np.degrees(view.acceptance_rad):g}°"
    )


def _pose_faults(
    shots: Sequence[PlannedShot], kinematics: Kinematics, limits: Limits
) -> Iterator[str]:
    """Name poses that cannot be taken, and joints that are not those of their pose."""
    # a pose exactly on a limit keeps it
    joint_scale = kinematics.mechanism.joints[0].scale
    tolerant = limits.narrowed_by(
        joint=-TOLERANCE_RAD * joint_scale, task=-TOLERANCE_RAD, swing_rad=-TOLERANCE_RAD
    )
    judged = kinematics.feasibility(tolerant, poses_of(shots))
    for row, shot in enumerate(shots):
        if not judged.feasible[row]:
            yield f"shot {shot.shot}: {'; '.join(judged.describe(row, limits))}"
        else:
            yield from _disagreement(shot, judged, row)


def _disagreement(shot: PlannedShot, judged: Feasibility, row: int) -> Iterator[str]:
    """Name the joint that is furthest from where the shot's pose wants it, if too far."""
    away = np.abs(np.array(shot.joints) - judged.joints[row])
    joint = int(np.argmax(away))
    axis = judged.chain.joints[joint]
    limit = AGREEMENT_RAD * axis.scale
    if not away[joint] <= limit:
        yield (
            f"shot {shot.shot}: {axis.column} is {axis.to_file(shot.joints[joint]):.4f}, but its "
            f"pose takes {axis.to_file(judged.joints[row, joint]):.4f} "
            f"(limit {axis.to_file(limit):g} away)"
        )


def _view_faults(shots: Sequence[PlannedShot], view: View) -> Iterator[str]:
    for shot in shots:
        if not shot.nest and (fault := view_fault(pose_row(shot.pose)[:3], view)):
            yield f"shot {shot.shot}: {fault}"


def _space_faults(shots: Sequence[PlannedShot], space: RestrictedSpace) -> Iterator[str]:
    """Name poses at which the plate is where it may not be."""
    for shot in shots:
        if fault := space.fault(pose_row(shot.pose)[:3]):
            yield f"shot {shot.shot}: {fault}"


def _nest_faults(
    shots: Sequence[PlannedShot], nests: Collection[str], lengths: Sequence[KnownLengthConfig]
) -> Iterator[str]:
    """Name shots of nests and lengths that campaign.yaml lacks, and nests without a shot."""
    ends: dict[int, list[str]] = {}
    for shot in shots:
        if shot.purpose is ShotSet.KNOWN_LENGTH and not shot.nest:
            yield (
                f"shot {shot.shot}: a known length is no pose of the robot: import its points, or "
                "name the nest at its end in the column nest"
            )
        elif shot.nest and shot.nest not in nests:
            yield f"shot {shot.shot}: nest {shot.nest} is not among nests in campaign.yaml"
        elif shot.pair is not None and shot.nest:
            ends.setdefault(shot.pair, []).append(shot.nest)
    for pair, both in ends.items():
        if len(set(both)) < len(both) or bar_of(lengths, pair, both) is None:
            yield f"pair {pair}: no known length lies between nests {' and '.join(both)}"
    for nest in sorted({*nests} - {shot.nest for shot in shots}):
        yield f"no shot measures nest {nest} of campaign.yaml"


def _drift_faults(shots: Sequence[PlannedShot]) -> Iterator[str]:
    """Name drift shots at another pose than the first: drift shows only where poses are equal."""
    drifts = [shot for shot in shots if shot.purpose is ShotSet.DRIFT]
    for shot in drifts[1:]:
        if shot.pose != drifts[0].pose:
            yield f"shot {shot.shot}: its drift pose is not that of shot {drifts[0].shot}"
