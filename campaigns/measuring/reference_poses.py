"""Rigid-body test: spread reference poses measured again; what moved, and how far.

A robot does not come back to the very same joints, and no measurement repeats itself. So the test
asks whether the displacement of the points, less what the joints as read explain, is larger than
the noise of both measurements. If it is, it asks what explains it: a rigid motion of all points
(the tracker, its stand or the robot's base), a changed offset of one encoder, or neither (the
robot).

`pkmcal check` asks the same of another day, of the fitted robot (`identification/checking.py`); six
shots place its frame alone. Here each pose is compared with itself: the robot's errors cancel, and
three poses are enough.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf, isfinite
from typing import TypeAlias

import numpy as np
import scipy

from campaigns.arrays import Array
from campaigns.evaluation.time_series import settling
from campaigns.fit.error_sources import by_first_joint
from campaigns.fit.rigid_transforms import fit_transform, frame_jacobian
from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.journal.records import Outcome
from campaigns.kinematics.model import Kinematics
from campaigns.planning.steps import Step
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import outcomes_covariance_mm2

FEWEST_POSES = 3
"""Least number of poses that show a rotation about any axis."""
MOST_POSES = 4
"""Number of poses that are measured again, if there are so many; each costs a motion."""
SPREAD_MM = 50.0
"""Least distance of a third pose from the line through the first two."""
SHOTS_FOR_AXES = 200
"""Largest number of accepted shots, spread over all, by which the tracker's axes are fitted."""
SIGNIFICANCE = 1e-4
"""Chance of poses that nothing has moved to look moved."""
LIKELY_WITHIN = 10.0
"""Largest difference of Akaike's score at which a cause is named beside the best one."""


ReferencePose: TypeAlias = tuple[Step, Outcome]
"""Pose to be measured again, and what was measured there first."""


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceNoise:
    """Noise by which poses that are measured twice may differ."""

    instrument: TrackerUncertainty
    """Uncertainty of shots for which the tracker stated none."""
    point_mm: float
    """Scatter of the robot's point, 1 σ."""
    joint: float = 0.0
    """Scatter of its first joint, 1 σ, rad or mm; others scatter in parts of their tolerance."""
    freedom: float = inf
    """Degrees of freedom by which the scatter is estimated."""
    limit_mm: float = inf
    """Root mean square of displacements beyond which poses count as moved, whatever the scatter."""

    def covariance_mm2(self, outcomes: Sequence[Outcome], point_by_joints: Array) -> Array:
        """Return the covariances (N, 3, 3) of shots' points: instrument, point and joints together.

        `point_by_joints` are ∂point/∂joints, (N, 3, n), of which each scatters as the first.
        """
        stated = outcomes_covariance_mm2(outcomes, self.instrument)
        of_joints = self.joint**2 * point_by_joints @ point_by_joints.swapaxes(1, 2)
        return np.asarray(stated + self.point_mm**2 * np.eye(3) + of_joints)


@dataclass(frozen=True, slots=True)
class PoseComparison:
    """Comparison of one set of poses, measured twice, in words."""

    size: str
    """By how much the measurements differ."""
    change: str = ""
    """What has changed; "" if noise explains the difference."""
    is_robots: bool = False
    """Whether no motion of the tracker, its stand or the base explains it."""


def reference_poses(steps: Sequence[Step], kept: Sequence[Outcome]) -> tuple[ReferencePose, ...]:
    """Choose three or four accepted poses far from each other and not on a line.

    A single one if there are no such poses; none without accepted shots. The first drift shot comes
    first, else the first shot.
    """
    # The second pose is farthest from the first, the third from the line through both: three points
    # that are not on a line show every rigid motion. The fourth is farthest from those chosen.
    outcomes = {outcome.shot: outcome for outcome in kept}
    poses = [(step, outcomes[shot]) for step in steps if (shot := step.planned.shot) in outcomes]
    poses.sort(key=lambda pose: pose[0].planned.purpose is not ShotSet.DRIFT)
    if len(poses) < FEWEST_POSES:
        return tuple(poses[:1])
    points = np.array([outcome.point_in_tracker_mm for _, outcome in poses])
    chosen = [0, int(np.argmax(np.linalg.norm(points - points[0], axis=1)))]
    along = points[chosen[1]] - points[0]
    length_mm = float(np.linalg.norm(along))
    if length_mm < SPREAD_MM:
        return (poses[0],)
    height_mm = np.linalg.norm(np.cross(points - points[0], along / length_mm), axis=1)
    if height_mm.max() < SPREAD_MM:
        return (poses[0],)
    chosen.append(int(np.argmax(height_mm)))
    while len(chosen) < min(MOST_POSES, len(poses)):
        nearest = np.linalg.norm(points[:, None] - points[chosen], axis=2).min(axis=1)
        chosen.append(int(np.argmax(nearest)))
    return tuple(poses[place] for place in chosen)


def pose_settling(
    nominal: Kinematics, kept: Sequence[Outcome], visits: Sequence[Outcome], noise: ReferenceNoise
) -> tuple[tuple[int, ...], str]:
    """Return the visits of one pose since which it stays, by their shots; and the text for it.

    `kept` are all accepted shots, as in `rigid_body_test`.
    """
    # The visits differ by the joints at which the robot really stood: that part is taken out with
    # the nominal robot, whose errors cancel in such small differences.
    axes, joints = _tracker_from_base(nominal, kept), np.array([visit.joints for visit in visits])
    points = np.array([visit.point_in_tracker_mm for visit in visits])
    points, by_joints = points - _positions(nominal, joints) @ axes.T, _derivatives(nominal, joints)
    by_first = by_first_joint(nominal.mechanism.joints, axes @ by_joints)
    covariance = noise.covariance_mm2(visits, by_first)
    return settling([visit.shot for visit in visits], points, covariance)


def rigid_body_test(
    nominal: Kinematics,
    kept: Sequence[Outcome],
    then: Sequence[Outcome],
    now: Sequence[Outcome],
    noise: ReferenceNoise,
) -> PoseComparison:
    """Compare two measurements of one set of poses.

    `kept` are all accepted shots, by which the directions of the tracker's axes are fitted.
    """
    # 1. Displacement of each point, less the displacement that the nominal robot makes between the
    #    joints as read then and now, turned into the tracker's frame.
    # 2. Whiten by the covariance of both measurements: what the tracker states, and the robot's
    #    scatter of points and of joints.
    # 3. Test the sum of squares: χ² if the scatter is known, Fisher's F if it was estimated. Beyond
    #    the limit of drift the poses count as moved even if a scattering robot could explain it.
    # 4. If they have moved, compare the causes that explain it.
    axes = _tracker_from_base(nominal, kept)
    q_then, q_now = (np.array([shot.joints for shot in outcomes]) for outcomes in (then, now))
    points, moved = (
        np.array([shot.point_in_tracker_mm for shot in outcomes]) for outcomes in (then, now)
    )
    commanded = (_positions(nominal, q_now) - _positions(nominal, q_then)) @ axes.T
    moved = moved - points - commanded
    by_joints = np.einsum("ab,nbj->naj", axes, _derivatives(nominal, q_then))
    by_first = by_first_joint(nominal.mechanism.joints, by_joints)
    covariance = sum(noise.covariance_mm2(outcomes, by_first) for outcomes in (then, now))
    whitening = np.linalg.inv(np.linalg.cholesky(covariance))
    seen = np.einsum("nab,nb->na", whitening, moved).ravel()
    chi2 = float(seen @ seen)
    size_mm = float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
    change, is_robots = "", False
    if size_mm > noise.limit_mm or not _may_be_chance(chi2, seen.size, noise.freedom):
        causes = {"frame": frame_jacobian(points - points.mean(axis=0))}
        for joint, axis in enumerate(nominal.mechanism.joints):
            causes[axis.name] = by_joints[:, :, joint : joint + 1]
        change, is_robots = _explain(seen, whitening, causes, size_mm, nominal, noise.freedom)
    largest_mm = float(np.linalg.norm(moved, axis=1).max())
    size = f"reference poses differ by up to {largest_mm:.3f} mm (χ² = {chi2:.1f}, ν = {seen.size})"
    return PoseComparison(size, change, is_robots)


def _explain(
    seen: Array,
    whitening: Array,
    causes: Mapping[str, Array],
    size_mm: float,
    nominal: Kinematics,
    freedom: float,
) -> tuple[str, bool]:
    """Return the causes that explain whitened displacements (3 N,), the likeliest first.

    Return also whether "frame" is not among them. `causes` are columns (N, 3, k) by the name of a
    joint or "frame".
    """
    # Each cause is fitted alone, and is possible if noise explains the remainder. Akaike's
    # criterion (1974) ranks them: squares plus twice the number of unknowns, so that a rigid motion
    # with its six does not win by their number. Causes that the poses cannot distinguish are all
    # named.
    possible: list[tuple[float, str]] = []
    is_robots = True
    axes = {axis.name: axis for axis in nominal.mechanism.joints}
    for name, by_cause in causes.items():
        columns = np.einsum("nab,nbm->nam", whitening, by_cause).reshape(seen.size, -1)
        size, *_ = np.linalg.lstsq(columns, seen, rcond=None)
        square, count = float(np.sum((seen - columns @ size) ** 2)), len(size)
        if not _may_be_chance(square, seen.size - count, freedom):
            continue
        if name in axes:
            change = axes[name].text(float(size[0]), "+.3f")
            words = f"the encoder of joint {name} has changed by {change}"
        else:
            is_robots = False
            words = (
                f"the tracker, its stand or the robot's base has moved: the points by "
                f"{size_mm:.3f} mm, turned by {np.degrees(np.linalg.norm(size[:3])):.4f}°"
            )
        possible.append((square + 2.0 * count, words))
    if not possible:
        words = (
            f"the robot has changed: the points moved by {size_mm:.3f} mm, and neither a motion of "
            "the tracker nor one encoder explains it"
        )
        return words, is_robots
    possible.sort(key=lambda cause: cause[0])
    best, _ = possible[0]
    likely = (words for score, words in possible if score <= best + LIKELY_WITHIN)
    return "; or ".join(likely), is_robots


def _may_be_chance(square: float, count: int, freedom: float) -> bool:
    """Test whether noise alone gives such a sum of squares, by Fisher's F or by χ².

    F is for a scatter that is estimated with so few degrees of freedom that it is uncertain itself.
    """
    p = (
        scipy.special.fdtrc(count, freedom, square / count)
        if isfinite(freedom)
        else scipy.special.chdtrc(count, square)
    )
    return bool(p >= SIGNIFICANCE)


def _tracker_from_base(nominal: Kinematics, outcomes: Sequence[Outcome]) -> Array:
    """Return the rotation (3, 3) tracker from base that best fits nominal positions to points."""
    outcomes = outcomes[:: 1 + len(outcomes) // SHOTS_FOR_AXES]
    modelled = nominal.forward(np.array([shot.joints for shot in outcomes]))
    points = np.array([shot.point_in_tracker_mm for shot in outcomes])
    solved = modelled.is_solved
    return fit_transform(nominal.points(modelled.values[solved]), points[solved]).rotation


def _positions(nominal: Kinematics, joints: Array) -> Array:
    """Return the positions (N, 3) in the base frame; raise `NoSolution`."""
    return nominal.points(nominal.forward(joints).values_or_raise())


def _derivatives(nominal: Kinematics, joints: Array) -> Array:
    """Return ∂position/∂joints, (N, 3, n)."""
    # A joint acts on the pose as the offset of its encoder does, whose columns the Jacobian has.
    poses = nominal.forward(joints).values_or_raise()
    offsets = nominal.mechanism.parameters.columns["joint_offset"]
    return np.asarray(nominal.point_jacobian(joints, poses)[..., offsets])
