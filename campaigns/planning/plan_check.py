"""Check of a plan, made or edited, before anything moves.

A plan is a file that users may edit, and the robot file may have changed since it was made. So
each run checks all of it again, by the nominal robot:

1. Single shots: the pose is within all limits, its joints are those of the pose, the plate stays in
   the space, the tracker sees the reflector.
2. Sets: drift shots share one pose; nests and known lengths are those of campaign.yaml.
3. Ways: between each two shots in order there is a safe joint move, straight or by a detour.

Every fault of steps 1 and 2 is collected before any is reported, so that a user can correct them
together. Step 3 comes last: it takes longest, and needs shots that are right in themselves.
"""

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from campaigns.arrays import Array
from campaigns.design.pose_sampling import incidence_rad
from campaigns.design.restricted_space import RestrictedSpace
from campaigns.design.tours import travel_rad
from campaigns.errors import PlanInvalid
from campaigns.kinematics.feasibility import Feasibility, Limits
from campaigns.kinematics.mechanism import Mechanism
from campaigns.kinematics.model import Kinematics
from campaigns.planning.paths import RobotModel, check_paths
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import View, poses_of
from campaigns.robots.robot import pose_row
from campaigns.settings.sections import KnownLengthConfig, bar_of
from campaigns.shots.shot_sets import ShotSet

AGREEMENT_RAD = float(np.radians(0.01))
"""Largest difference between a row's joints and those of its pose: of cranks, or what compares."""
LIMIT_TOLERANCE_RAD = 1e-9
"""Rounding by which a pose may exceed a limit."""
REFLECTOR_MOVE_S = 120.0
"""Time in which an operator moves the reflector to another part of the platform, estimated."""
FAULTS_NAMED = 5
"""Number of faults that an error lists."""


@dataclass(frozen=True, slots=True)
class Pace:
    """Speed between shots, and the time that each shot takes besides."""

    joint_speed_rad_s: float
    settle_s: float
    measure_s: float

    def seconds(self, shots: int, travel_rad: float) -> float:
        """Return the time of shots and the ways between them; ramps are not counted."""
        return travel_rad / self.joint_speed_rad_s + shots * (self.settle_s + self.measure_s)


@dataclass(frozen=True, slots=True)
class PlanLimits:
    """Robot, view, pace, nests and known lengths that a plan is checked against."""

    robot: RobotModel
    view: View
    pace: Pace
    nests: Collection[str] = ()
    """Names of the nests in campaign.yaml."""
    known_lengths: Sequence[KnownLengthConfig] = ()


@dataclass(frozen=True, slots=True)
class CheckedPlan:
    """Plan that can be run, with its detours and duration."""

    shots: tuple[PlannedShot, ...]
    detours: int
    """Number of ways between shots that are not straight because that would not be safe."""
    seconds: float
    """Duration of the whole plan, estimated; moves of the reflector included."""

    @property
    def reflector_moves(self) -> tuple[int, ...]:
        """Numbers of the shots before which the reflector is moved to another place."""
        return reflector_moves(self.shots)


def check_plan(
    shots: Sequence[PlannedShot], limits: PlanLimits, tell: Callable[[str], None] = lambda _: None
) -> CheckedPlan:
    """Check shots, sets and ways of a plan, and return it with its duration.

    `tell` is called with words on the progress. Raise `PlanInvalid` that names the shots at fault
    with value and limit.
    """
    robot = limits.robot
    refuse(
        [
            *_pose_faults(shots, robot.kinematics, robot.limits),
            *_space_faults(shots, robot.space),
            *_view_faults(shots, limits.view, robot.kinematics.mechanism),
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
    seconds += REFLECTOR_MOVE_S * len(reflector_moves(shots))
    return CheckedPlan(tuple(shots), paths.detours, seconds)


def reflector_moves(shots: Sequence[PlannedShot]) -> tuple[int, ...]:
    """Return the numbers of the shots before which the reflector is moved to another place."""
    on_robot = [shot for shot in shots if shot.purpose.on_robot]
    return tuple(
        shot.shot for before, shot in pairwise(on_robot) if shot.reflector != before.reflector
    )


def seconds_of_visits(
    count: int, shots: Sequence[PlannedShot], kinematics: Kinematics, pace: Pace
) -> float:
    """Return the time of further visits of the drift pose, anywhere between other shots."""
    drift = [shot.joints for shot in shots if shot.purpose is ShotSet.DRIFT]
    others = [shot.joints for shot in shots if shot.purpose is not ShotSet.DRIFT and not shot.nest]
    pose, turns = (kinematics.comparable(np.array(joints)) for joints in (drift[0], others))
    away, direct = travel_rad(turns, pose), travel_rad(turns[:-1], turns[1:])
    return pace.seconds(count, count * float(np.mean(away[:-1] + away[1:] - direct)))


def refuse(faults: Sequence[str], *, remedy: str) -> None:
    """Raise `PlanInvalid` with the first faults, if there are any."""
    if not faults:
        return
    more = f" … and {len(faults) - FAULTS_NAMED} more" if len(faults) > FAULTS_NAMED else ""
    raise PlanInvalid(" | ".join(faults[:FAULTS_NAMED]) + more, remedy=remedy)


def view_fault(pose: Array, view: View, mechanism: Mechanism) -> str:
    """Return why the reflector at a pose (t,) cannot be seen; empty if it can."""
    facing = mechanism.facing(pose[None], np.array(view.facing) / np.linalg.norm(view.facing))
    (angle,) = incidence_rad(pose[None, :3], np.array(view.tracker_mm), facing)
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
    # Limits are widened by rounding, because a pose exactly on a limit is allowed; what an error
    # prints are the limits themselves.
    tolerant = limits.narrowed_by(
        joint=kinematics.mechanism.travel(-LIMIT_TOLERANCE_RAD),
        task=-LIMIT_TOLERANCE_RAD,
        swing_rad=-LIMIT_TOLERANCE_RAD,
    )
    judged = kinematics.feasibility(tolerant, poses_of(shots))
    for row, shot in enumerate(shots):
        if not judged.feasible[row]:
            yield f"shot {shot.shot}: {'; '.join(judged.describe(row, limits))}"
        else:
            yield from _disagreement(shot, judged, row)


def _disagreement(shot: PlannedShot, judged: Feasibility, row: int) -> Iterator[str]:
    """Name the joint of a shot that differs most from its pose's, if by more than the limit."""
    # Joints are what is commanded, the pose is what all other checks judge. Where a user edited one
    # of them alone, the robot would go where nothing was checked.
    away = np.abs(np.array(shot.joints) - judged.joints[row])
    joint = int(np.argmax(away))
    axis = judged.mechanism.joints[joint]
    limit = AGREEMENT_RAD * axis.scale
    if not away[joint] <= limit:  # "not <=", so that NaN is a fault as well
        yield (
            f"shot {shot.shot}: {axis.column} is {axis.to_file(shot.joints[joint]):.4f}, but its "
            f"pose takes {axis.to_file(judged.joints[row, joint]):.4f} "
            f"(limit {axis.to_file(limit):g} away)"
        )


def _view_faults(shots: Sequence[PlannedShot], view: View, mechanism: Mechanism) -> Iterator[str]:
    """Name shots at which the robot's reflector looks too far away from the tracker."""
    # nests have reflectors of their own, whose direction no file states
    for shot in shots:
        if not shot.nest and (fault := view_fault(pose_row(shot.pose), view, mechanism)):
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
    # 1. Each shot by itself; the two nests of each pair are gathered for step 2.
    nests_of_pair: dict[int, list[str]] = {}
    for shot in shots:
        if shot.purpose is ShotSet.KNOWN_LENGTH and not shot.nest:
            yield (
                f"shot {shot.shot}: a known length is no pose of the robot: import its points, or "
                "name the nest at its end in the column nest"
            )
        elif shot.nest and shot.nest not in nests:
            yield f"shot {shot.shot}: nest {shot.nest} is not among nests in campaign.yaml"
        elif shot.pair is not None and shot.nest:
            nests_of_pair.setdefault(shot.pair, []).append(shot.nest)
    # 2. A pair is two different nests, between which campaign.yaml states a length.
    for pair, names in nests_of_pair.items():
        if len(set(names)) < len(names) or bar_of(lengths, pair, names) is None:
            yield f"pair {pair}: no known length lies between nests {' and '.join(names)}"
    # 3. A nest that a user listed but forgot to plan would be missed only at the end of a run.
    for nest in sorted({*nests} - {shot.nest for shot in shots}):
        yield f"no shot measures nest {nest} of campaign.yaml"


def _drift_faults(shots: Sequence[PlannedShot]) -> Iterator[str]:
    """Name drift shots at another pose than the first one."""
    # What changes with time can be separated from what depends on the pose only at equal poses.
    drifts = [shot for shot in shots if shot.purpose is ShotSet.DRIFT]
    for shot in drifts[1:]:
        if shot.pose != drifts[0].pose:
            yield f"shot {shot.shot}: its drift pose is not that of shot {drifts[0].shot}"
