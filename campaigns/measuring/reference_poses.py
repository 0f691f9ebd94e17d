"""Rigid-body test: spread reference poses measured again; what moved, and how far."""

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite

import numpy as np
from scipy.special import chdtrc, fdtrc

from campaigns.arrays import Array
from campaigns.estimation.rigid_transforms import fit_transform
from campaigns.estimation.tracker_noise import TrackerUncertainty, inverse_roots
from campaigns.estimation.variance_components import VarianceComponents
from campaigns.journal.records import Outcome
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.planning.steps import Step
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import outcomes_covariance_mm2

FEWEST = 3
MOST = 4
SPREAD_MM = 50.0
"""Least distance of a third pose from the line through the first two."""
SIGNIFICANCE = 1e-4
"""Chance of poses that nothing has moved to look moved."""
LIKELY = 10.0
"""Difference of score up to which a cause is named beside the best."""
RIGID_FREEDOM = 6


@dataclass(frozen=True, slots=True)
class ReferencePose:
    """Pose to be measured again, and what was measured there first."""

    step: Step
    then: Outcome


@dataclass(frozen=True, slots=True, eq=False)
class ReferenceNoise:
    """Noise by which poses measured twice may differ."""

    robot: VarianceComponents
    instrument: TrackerUncertainty
    """Of shots of which the tracker stated nothing."""
    factor: float = 1.0
    """What the fit that found it leaves over what it says."""
    freedom: float = inf
    """Degrees of freedom by which it is known."""
    limit_mm: float = inf
    """Farther, by root mean square, is moved, whatever scatters: for a scatter nobody knows."""


@dataclass(frozen=True, slots=True)
class BodyComparison:
    """Result of measuring reference poses again."""

    largest_mm: float
    """Of the distances between then and now, the joints as read taken into account."""
    chi2: float
    freedom: int
    change: str
    """What has changed, in words; empty where scatter explains all."""

    @property
    def text(self) -> str:
        """All of it, for the journal."""
        figures = (
            f"up to {self.largest_mm:.3f} mm from where they were, χ² {self.chi2:.1f} of "
            f"{self.freedom}"
        )
        return f"{figures}: {self.change or 'neither tracker nor robot has changed'}"


def reference_poses(steps: Sequence[Step], kept: Sequence[Outcome]) -> tuple[ReferencePose, ...]:
    """Three or four accepted poses far from each other and not on a line; one where there are few.

    The first drift shot is the first of them, or else the first shot.
    """
    was = {outcome.shot: outcome for outcome in kept}
    taken = [ReferencePose(step, was[shot]) for step in steps if (shot := step.planned.shot) in was]
    taken.sort(key=lambda each: each.step.planned.purpose is not ShotSet.DRIFT)
    if len(taken) < FEWEST:
        return tuple(taken[:1])
    points = np.array([each.then.point_in_tracker_mm for each in taken])
    chosen = [0, int(np.argmax(np.linalg.norm(points - points[0], axis=1)))]
    along = points[chosen[1]] - points[0]
    length_mm = float(np.linalg.norm(along))
    if length_mm < SPREAD_MM:
        return (taken[0],)
    height_mm = np.linalg.norm(np.cross(points - points[0], along / length_mm), axis=1)
    if height_mm.max() < SPREAD_MM:
        return (taken[0],)
    chosen.append(int(np.argmax(height_mm)))
    while len(chosen) < min(MOST, len(taken)):
        nearest = np.linalg.norm(points[:, None] - points[chosen], axis=2).min(axis=1)
        chosen.append(int(np.argmax(nearest)))
    return tuple(taken[place] for place in chosen)


def rigid_body_test(
    nominal: Kinematics,
    kept: Sequence[Outcome],
    then: Sequence[Outcome],
    now: Sequence[Outcome],
    noise: ReferenceNoise,
) -> BodyComparison:
    """What has moved between two measurements of the same poses.

    `kept` are all accepted shots: they say how the tracker's axes lie. A displacement that the
    scatter of both measurements does not explain is the tracker's (or the base's) when a rigid
    motion explains it, an encoder's when one joint's offset does, and else the robot's.
    """
    axes = _tracker_from_base(nominal, kept)
    q_then, q_now = (np.array([each.joints for each in outcomes]) for outcomes in (then, now))
    points, moved = (
        np.array([each.point_in_tracker_mm for each in outcomes]) for outcomes in (then, now)
    )
    commanded = (_positions(nominal, q_now) - _positions(nominal, q_then)) @ axes.T
    moved = moved - points - commanded
    by_joints = np.einsum("ab,nbj->naj", axes, _by_joints(nominal, q_then))
    covariance = sum(
        noise.robot.covariance_mm2(outcomes_covariance_mm2(each, noise.instrument), by_joints)
        for each in (then, now)
    )
    whitening = inverse_roots(np.asarray(covariance)) / noise.factor
    seen = np.einsum("nab,nb->na", whitening, moved).ravel()
    chi2 = float(seen @ seen)
    whitened = _Displacements(seen, whitening, noise.freedom)
    largest_mm = float(np.linalg.norm(moved, axis=1).max())
    size_mm = float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
    unmoved = size_mm <= noise.limit_mm and whitened.may_be_chance(chi2, 0)
    change = "" if unmoved else _cause(whitened, nominal, points, moved, by_joints)
    return BodyComparison(largest_mm, chi2, seen.size, change)


@dataclass(frozen=True, slots=True)
class _Cause:
    """Cause that may explain the displacements."""

    words: str
    left: float
    """χ² that it leaves."""
    parameters: int

    @property
    def score(self) -> float:
        """What it leaves, and what it costs (Akaike 1974): the smaller, the likelier."""
        return self.left + 2.0 * self.parameters


@dataclass(frozen=True, slots=True, eq=False)
class _Displacements:
    """Displacements (3 N,), whitened, and what whitens a cause's columns, (N, 3, 3)."""

    seen: Array
    whitening: Array
    freedom: float
    """Degrees of freedom by which the scatter is known."""

    def fitted(self, columns: Array) -> tuple[Array, float]:
        """Best size of a cause with these columns (N, 3, m), and the χ² it leaves."""
        own = np.einsum("nab,nbm->nam", self.whitening, columns)
        own = own.reshape(self.seen.size, -1)
        size, *_ = np.linalg.lstsq(own, self.seen, rcond=None)
        return np.asarray(size), float(np.sum((self.seen - own @ size) ** 2))

    def may_be_chance(self, left: float, parameters: int) -> bool:
        """Whether scatter alone leaves as much: Fisher's F, for the scatter is an estimate."""
        rest = self.seen.size - parameters
        known = isfinite(self.freedom)
        p = fdtrc(rest, self.freedom, left / rest) if known else chdtrc(rest, left)
        return bool(p >= SIGNIFICANCE)


def _cause(
    seen: _Displacements, nominal: Kinematics, points: Array, moved: Array, by_joints: Array
) -> str:
    """What explains the displacements, the likeliest first, in words."""
    size_mm = float(np.sqrt(np.mean(np.sum(moved**2, axis=1))))
    rigid, left = seen.fitted(_rigid_columns(points))
    turned = np.degrees(np.linalg.norm(rigid[3:]))
    words = (
        f"the tracker, its stand or the robot's base has moved: the points by {size_mm:.3f} mm, "
        f"turned by {turned:.4f}°"
    )
    causes = [_Cause(words, left, RIGID_FREEDOM)]
    for joint, axis in enumerate(nominal.mechanism.joints):
        (offset,), left = seen.fitted(by_joints[:, :, joint : joint + 1])
        words = f"the encoder of joint {axis.name} has changed by {axis.text(offset, '+.3f')}"
        causes.append(_Cause(words, left, 1))
    able = [each for each in causes if seen.may_be_chance(each.left, each.parameters)]
    if not able:
        return (
            f"the robot has changed: the points moved by {size_mm:.3f} mm, and neither a motion of "
            "the tracker nor one encoder explains it"
        )
    able.sort(key=lambda each: each.score)
    return "; or ".join(each.words for each in able if each.score <= able[0].score + LIKELY)


def _rigid_columns(points: Array) -> Array:
    """∂point/∂(translation, rotation about the middle), (N, 3, 6)."""
    columns = np.zeros((len(points), 3, RIGID_FREEDOM))
    columns[:, :, :3] = np.eye(3)
    arms = points - points.mean(axis=0)
    for axis in range(3):
        columns[:, :, 3 + axis] = np.cross(np.eye(3)[axis], arms)
    return columns


def _tracker_from_base(nominal: Kinematics, outcomes: Sequence[Outcome]) -> Array:
    """Rotation (3, 3) by the best fit of nominal positions to points."""
    modelled = nominal.forward(np.array([each.joints for each in outcomes]))
    points = np.array([each.point_in_tracker_mm for each in outcomes])
    found = modelled.found
    return fit_transform(modelled.values[found, :3], points[found]).rotation


def _positions(nominal: Kinematics, joints: Array) -> Array:
    """(N, 3), in the base frame; raises `NoSolution`."""
    return np.asarray(nominal.forward(joints).values_or_raise()[:, :3])


def _by_joints(nominal: Kinematics, joints: Array) -> Array:
    """∂position/∂joints, (N, 3, n): an arm turns as by its encoder's offset."""
    poses = nominal.forward(joints).values_or_raise()
    offsets = nominal.mechanism.parameters.offsets
    return np.asarray(nominal.jacobian(joints, poses)[:, :3][:, :, offsets])
