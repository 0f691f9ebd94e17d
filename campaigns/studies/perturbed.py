"""Perturbed campaigns: measured shots of a true robot to which something happened.

True points come from the true robot's forward model (or from one that knows nothing of the
estimator), plus noise as the tracker states it, plus the perturbation: no linearisation anywhere.
"""

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.estimation.information import point_jacobian, predict_points, whitened
from campaigns.estimation.observability import orthonormal_basis
from campaigns.estimation.tracker_noise import TrackerUncertainty, point_covariance_mm2
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.settings.sections import KnownLengthConfig
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import COLUMNS, Shots
from campaigns.studies.perturbations import Perturbation
from campaigns.studies.study import Forward, StudySetup, fitted_rows

FEWEST_BEYOND = 8
"""Fitted shots before a step, and after it."""
BAR = KnownLengthConfig(name="bar", length_mm=1000.0, std_mm=0.005)
BAR_PLACES, BAR_WITHIN_MM = 5, 400.0
LATE = (3, 9)
"""Shots after a late step: from so many to one less than so many."""
BETWEEN_SESSIONS = 1.0 / 3.0
"""Share of steps that are between two sessions of equal length."""
WARMING = 3.0
"""Time constants of warming in a campaign."""
DIFFERENCE = 1e-6
"""Of a joint, for derivatives of robots that know none."""


@dataclass(frozen=True, slots=True, eq=False)
class PerturbedCampaign:
    """Measured shots, and what is true of them."""

    shots: Shots
    free: tuple[str, ...]
    true: Kinematics
    """The robot as it is at the end, as far as the free parameters go."""
    forward: Forward
    """Points of the robot as it is at the end."""
    covariance_mm2: Array
    """Of every shot, with the robot's own scatter, in the base's axes, (N, 3, 3)."""
    shift_mm: Array
    """What a step or drift moved each point by, in the base's axes, (N, 3)."""
    perturbation: Perturbation
    arm: int = -1
    """The one that has the step."""
    first_after: int = -1
    """Number of the first fitted shot after a step."""
    gross: frozenset[int] = field(default_factory=frozenset)
    """Numbers of the shots that are off."""

    def least_std(self) -> Array:
        """Standard deviations, (F,), mm and rad, at best: by coordinates of known covariances."""
        rows, poses = self._fitted()
        found, _ = predict_points(
            self.true, self.free, self.shots.joints[rows], poses, self.covariance_mm2[rows]
        )
        return np.sqrt(np.diag(found)[: len(self.free)])

    def signal(self) -> float:
        """Part of the shift that no parameter and no frame explains, in σ.

        The square is what the best of all tests, with cause and place known, gains of it.
        """
        if not self.shift_mm.any():
            return 0.0
        rows, poses = self._fitted()
        jacobian = point_jacobian(self.true, self.free, self.shots.joints[rows], poses)
        both = np.concatenate([jacobian, self.shift_mm[rows, :, None]], axis=2)
        flat = whitened(both, self.covariance_mm2[rows]).reshape(3 * len(rows), -1)
        explained = orthonormal_basis(flat[:, :-1])
        return float(np.linalg.norm(flat[:, -1] - explained @ (explained.T @ flat[:, -1])))

    def _fitted(self) -> tuple[Index, Array]:
        """Rows to identify from, and the robot's poses at them."""
        rows = fitted_rows(self.shots)
        return rows, self.true.forward(self.shots.joints[rows]).values_or_raise()


def perturbed_campaign(
    setup: StudySetup, perturbation: Perturbation, truth: Array, rng: np.random.Generator
) -> PerturbedCampaign:
    """Campaign with the robot of a parameter vector (G,); raises `NoSolution`.

    A perturbation beyond the model needs `setup.beyond_model`.
    """
    mechanism = setup.nominal.mechanism
    before = Kinematics(mechanism, truth)
    arm = int(rng.integers(mechanism.parameters.arms))
    shots = _series(setup, perturbation, rng)
    fitted = fitted_rows(shots)
    first = (
        len(shots) - int(rng.integers(*LATE)) if perturbation.late else _first_after(rng, fitted)
    )
    after = _changed(before, perturbation, arm, rng)
    told = after
    joints = shots.joints + _backlash(before, perturbation) * rng.choice(
        [-0.5, 0.5], shots.joints.shape
    )
    forward = _points_of(after)
    if perturbation.beyond_the_model:
        assert setup.beyond_model is not None, "only asked for where there is one"
        in_time, p = setup.beyond_model(after, perturbation, rng)
        forward = lambda joints: in_time(joints, 1.0)  # noqa: E731 - one of two, as the other
        put_out = perturbation.imperfect_parts or perturbation.azimuths_mrad
        if not put_out or {*setup.free} & {*mechanism.parameters.extensions}:
            told = Kinematics(mechanism, p)
        in_base = in_time(joints, np.linspace(0.0, 1.0, len(shots)))
    else:
        in_base = forward(joints)
    shift = in_base - forward(joints) if perturbation.warmth_ppm else np.zeros_like(in_base)
    passed = _passed(perturbation, len(shots), first)[:, None]
    if after is not before:
        begun = _points_of(before)(joints)
        shift = passed * (in_base - begun)
        in_base = begun + shift
    if perturbation.scatter_mm > 0.0:
        in_base = in_base + perturbation.scatter_mm * rng.uniform(-1.0, 1.0, in_base.shape)
    frame, turn = setup.tracker_from_base, setup.tracker_from_base.rotation
    points = frame.apply(in_base)
    if "frame" in (perturbation.step, perturbation.drift):
        moved = passed * _any_direction(rng, 1, perturbation.size)
        points, shift = points + moved, moved @ turn
    wrong = rng.choice(fitted, perturbation.gross, replace=False)
    off = _any_direction(rng, perturbation.gross, perturbation.size)
    if perturbation.along_pairs:
        off = _along_pairs(shots, points, wrong, perturbation.size)
    points[wrong] += off
    if perturbation.swapped:
        one = int(rng.integers(len(shots) - 1))
        points[[one, one + 1]] = points[[one + 1, one]]
    if perturbation.cause:
        assert setup.misread is not None, "as before"
        points = setup.misread(points, perturbation)
    stated = point_covariance_mm2(points, setup.options.instrument)
    roots = np.linalg.cholesky(stated)
    points = points + np.einsum("nij,nj->ni", roots, rng.standard_normal(points.shape))
    measured = replace(shots, points_in_tracker_mm=points, stated_covariance_mm2=stated)
    return PerturbedCampaign(
        shots=_as_read(measured, perturbation, setup.options.instrument, rng),
        free=setup.free,
        true=told,
        forward=forward,
        covariance_mm2=turn.T @ stated @ turn
        + _own_mm2(before, perturbation, forward, shots.joints),
        shift_mm=shift,
        perturbation=perturbation,
        arm=arm,
        first_after=shots.numbers[first],
        gross=frozenset(shots.numbers[row] for row in wrong.tolist()),
    )


def with_known_lengths(
    shots: Shots, ends_mm: Array, instrument: TrackerUncertainty, rng: np.random.Generator
) -> Shots:
    """Shots, and pairs of a known length between true points (M, 3), without the robot."""
    count, stated = len(ends_mm), point_covariance_mm2(ends_mm, instrument)
    noise = np.linalg.cholesky(stated) @ rng.standard_normal((count, 3, 1))
    pairs = max((pair for pair in shots.pairs if pair is not None), default=-1) + 1
    numbers = max(shots.numbers) + 1
    ends = replace(
        shots.rows(np.zeros(count, dtype=np.intp)),
        numbers=tuple(range(numbers, numbers + count)),
        purposes=(ShotSet.KNOWN_LENGTH,) * count,
        pairs=tuple(pairs + row // 2 for row in range(count)),
        joints=np.full((count, shots.joints.shape[1]), np.nan),
        points_in_tracker_mm=ends_mm + noise[:, :, 0],
        stated_covariance_mm2=stated,
    )

    def joined(name: str) -> Any:
        own, added = getattr(shots, name), getattr(ends, name)
        return np.concatenate([own, added]) if isinstance(own, np.ndarray) else own + added

    return Shots(**{name: joined(name) for name in COLUMNS})


def _bar_points(about_mm: Array, rng: np.random.Generator) -> Array:
    """Ends of a bar put down in any direction about a point (3,), one after the other, (10, 3)."""
    length_mm = BAR.length_mm + BAR.std_mm * rng.standard_normal()
    middle_mm = about_mm + rng.uniform(-BAR_WITHIN_MM, BAR_WITHIN_MM, (BAR_PLACES, 3))
    half_mm = _any_direction(rng, BAR_PLACES, 0.5 * length_mm)
    return np.stack([middle_mm - half_mm, middle_mm + half_mm], axis=1).reshape(-1, 3)


def _as_read(
    shots: Shots,
    perturbation: Perturbation,
    instrument: TrackerUncertainty,
    rng: np.random.Generator,
) -> Shots:
    """Shots as a tracker reads them whose scale is off, beside those of a known length."""
    if perturbation.known_length:
        ends_mm = _bar_points(shots.points_in_tracker_mm.mean(axis=0), rng)
        shots = with_known_lengths(shots, ends_mm, instrument, rng)
    return replace(
        shots,
        points_in_tracker_mm=perturbation.scale * shots.points_in_tracker_mm,
        stated_covariance_mm2=perturbation.scale**2 * shots.stated_covariance_mm2,
    )


def _series(setup: StudySetup, perturbation: Perturbation, rng: np.random.Generator) -> Shots:
    """Shots of the plan as they are taken: all of them, or moved together, or in another order.

    Those in a part of the workspace lie about one that is farthest out. Raises `NoSolution`.
    """
    shots, part = setup.shots, perturbation.measured
    if perturbation.late:
        return shots.rows(rng.permutation(len(shots)))
    if part == 1.0:
        return shots
    poses = shots.commanded
    away = np.linalg.norm(poses[:, :3] - poses[:, :3].mean(axis=0), axis=1)
    farthest = poses[int(np.argmax(away))]
    moved = farthest + part * (poses - farthest)
    return replace(shots, commanded=moved, joints=setup.nominal.inverse(moved).values_or_raise())


def _first_after(rng: np.random.Generator, fitted: Index) -> int:
    """Row of the first shot after a step: between two sessions of equal length, or anywhere."""
    beyond = min(FEWEST_BEYOND, len(fitted) // 2)
    place = int(rng.integers(beyond, len(fitted) - beyond + 1))
    between = rng.random() < BETWEEN_SESSIONS
    return int(fitted[min(len(fitted) // 2 if between else place, len(fitted) - 1)])


def _changed(
    before: Kinematics, perturbation: Perturbation, arm: int, rng: np.random.Generator
) -> Kinematics:
    """Robot after a step or warming; the same one where it stays as it is."""
    space, p = before.mechanism.parameters, before.p.copy()
    lengths = space.places(space.arm_lengths)
    if perturbation.step == "joint":
        turn = np.radians(perturbation.size) * before.mechanism.joints[arm].scale
        p[space.offsets[arm]] += turn * rng.choice([-1.0, 1.0])
    elif perturbation.step == "length":
        p[lengths[arm]] += perturbation.size
    elif perturbation.step == "mount":
        p[space.places([f"arm{arm}.{axis}_mm" for axis in "xyz"])] += _any_direction(
            rng, 1, perturbation.size
        )[0]
    elif perturbation.drift == "arms":
        p[lengths] += perturbation.size
    else:
        return before
    return Kinematics(before.mechanism, p)


def _backlash(robot: Kinematics, perturbation: Perturbation) -> Array:
    """Lost motion of each joint from one side to the other, (n,), rad or mm."""
    scales = np.array([axis.scale for axis in robot.mechanism.joints])
    return np.asarray(np.radians(perturbation.backlash_deg) * scales)


def _passed(perturbation: Perturbation, count: int, first: int) -> Array:
    """Part of the change that has come about at each shot, (N,).

    Between a cold robot's points and a warm one's a straight line is taken: 0.2 mm of growth bends
    it by less than 0.1 µm.
    """
    if perturbation.drift == "arms":
        way = np.linspace(0.0, 1.0, count)
        return np.asarray(np.expm1(-WARMING * way) / np.expm1(-WARMING))
    if perturbation.drift:
        return np.linspace(0.0, 1.0, count)
    return np.asarray(np.arange(count) >= first, dtype=np.float64)


def _any_direction(rng: np.random.Generator, count: int, size_mm: float) -> Array:
    drawn = rng.standard_normal((count, 3))
    return np.asarray(size_mm * drawn / np.linalg.norm(drawn, axis=1, keepdims=True))


def _along_pairs(shots: Shots, points: Array, rows: Index, size_mm: float) -> Array:
    """Vectors away from the other shot of each row's pair."""
    pairs = np.array([-1 if pair is None else pair for pair in shots.pairs])
    gaps = [points[row] - points[pairs == pairs[row]].mean(axis=0) for row in rows.tolist()]
    lines = np.reshape(gaps, (len(rows), 3))
    return np.asarray(size_mm * lines / np.linalg.norm(lines, axis=1, keepdims=True))


def _points_of(robot: Kinematics) -> Forward:
    return lambda joints: robot.forward(joints).values_or_raise()[:, :3]


def _own_mm2(
    robot: Kinematics, perturbation: Perturbation, forward: Forward, joints: Array
) -> Array:
    """Covariance of the robot's own scatter, in the base's axes, (N, 3, 3)."""
    own = np.broadcast_to(perturbation.scatter_mm**2 / 3.0 * np.eye(3), (len(joints), 3, 3))
    if not perturbation.backlash_deg:
        return own
    steps = DIFFERENCE * np.eye(joints.shape[1])
    moved = [forward(joints + step) - forward(joints - step) for step in steps]
    by_joints = (
        np.stack(moved, axis=-1) / (2.0 * DIFFERENCE) * (0.5 * _backlash(robot, perturbation))
    )
    return np.asarray(own + by_joints @ by_joints.swapaxes(1, 2))
