"""Campaigns of drawn robots with what makes a result wrong: no linearisation anywhere.

True points come from the true robot's forward model (or from eight rods that know nothing of the
estimator), plus noise as the tracker states it, plus what a scenario does to robot and stand.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from benchmarks.shared.prototype import FREE, FREE_ANGLES, FREE_PLACES, NOMINAL, ROBOT, SPACE
from campaigns.api import plan
from campaigns.arrays import Array, Index
from campaigns.design.pose_sampling import workspace_poses
from campaigns.estimation.information import point_jacobian, predict_points, whitened
from campaigns.estimation.tracker_noise import TrackerUncertainty, point_covariance_mm2
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots
from campaigns.studies.study import planned_shots
from sim.geometry import FLAT_NAMES, geometry_of
from sim.robot.rods import Build, EightRods, Plate
from sim.scenarios.scenario import load_scenario

TRACKER_MM = (2400.0, -300.0, -450.0)
INSTRUMENT = TrackerUncertainty()
"""Better along the beam than across it: 6 µm, and 17 µm at 2.4 m."""
PAIRS, PLAN_SEED = 60, 3
ERROR_STD = np.where(FREE_ANGLES, np.radians(0.1), 1.0)
"""Of the true robots' parameters about the nominal ones, rad and mm."""
REPEATABILITY_MM = 0.4 / 3**0.5
"""Half-width of an even draw on each coordinate."""
BACKLASH_RAD = float(np.radians(1.0 / 60.0))
"""From one side to the other."""
WORKSPACE_SEED, WORKSPACE_POSES = 1, 300
FEWEST_BEYOND = 8
"""Fitted shots before a step, and after it."""
SECTION = load_scenario("realistic").robot
DIFFERENCE_RAD = 1e-6

Forward = Callable[[Array], Array]
"""From joints (N, 4), and a robot, to its points in the base frame, (N, 3)."""


@dataclass(frozen=True, slots=True)
class Effects:
    """What happens in a campaign beside the tracker's noise."""

    pairs: int = PAIRS
    repeatability: bool = False
    backlash: bool = False
    step: str = ""
    """`joint`, `length` or `frame`."""
    size: float = 0.0
    """Of a step: deg or mm; of a drift: mm; of gross errors: mm."""
    drift: str = ""
    """`frame` from first shot to last, or `arms` that grow warm."""
    gross: int = 0
    """Shots that are off by `size`."""
    along_pairs: bool = False
    """Whether they are off along the line to their partners, so that distances are off as much."""
    rods_mm: float = 0.0
    """Standard deviation of each rod's length."""
    axes_mrad: float = 0.0
    """Standard deviation of the motor axes' tilts."""

    @property
    def has_rods(self) -> bool:
        return self.rods_mm > 0.0 or self.axes_mrad > 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Simulated:
    """Measured shots, and what is true of them."""

    shots: Shots
    true_parameters: Array
    """The free ones, of the robot as it is at the end, (F,), mm and rad."""
    forward: Forward
    """Points of the robot as it is at the end."""
    covariance_mm2: Array
    """Of every shot, with the robot's own scatter, (N, 3, 3)."""
    poses: Array
    shift_mm: Array
    """What a step or drift moved each point by, (N, 3)."""
    step: str = ""
    """As in `Effects`."""
    arm: int = -1
    """That has the step."""
    first_after: int = -1
    """Number of the first fitted shot after a step."""
    gross: frozenset[int] = frozenset()
    """Numbers of the shots that are off."""

    def least_std(self) -> Array:
        """What the data allow at best, with every covariance known, (F,)."""
        rows = self._fitted()
        joints, poses = self.shots.joints[rows], self.poses[rows]
        found = predict_points(self._true(), FREE, joints, poses, self.covariance_mm2[rows])
        return np.asarray(found.std)

    def signal(self) -> float:
        """What no parameter and no frame explains of the shift, in σ.

        The square is what the best of all tests, with cause and place known, gains of it.
        """
        rows = self._fitted()
        jacobian = point_jacobian(self._true(), FREE, self.shots.joints[rows], self.poses[rows])
        both = np.concatenate([jacobian, self.shift_mm[rows, :, None]], axis=2)
        flat = whitened(both, self.covariance_mm2[rows]).reshape(3 * len(rows), -1)
        scaled = flat[:, :-1] / np.linalg.norm(flat[:, :-1], axis=0)
        explained, _ = np.linalg.qr(scaled)
        return float(np.linalg.norm(flat[:, -1] - explained @ (explained.T @ flat[:, -1])))

    def _fitted(self) -> Index:
        return np.flatnonzero([each is ShotSet.IDENTIFICATION for each in self.shots.purposes])

    def _true(self) -> Kinematics:
        return Kinematics(NOMINAL.mechanism, _whole(self.true_parameters))


@cache
def planned() -> Shots:
    """Shots of a plan without drift shots: 60 pairs for the fit, 20 that it never sees."""
    made = plan(ROBOT, TRACKER_MM, shots=2 * PAIRS, seed=PLAN_SEED)
    return planned_shots([shot for shot in made.shots if shot.purpose is not ShotSet.DRIFT])


@cache
def workspace() -> Array:
    """Poses at which positions are judged, (300, 4)."""
    rng = np.random.default_rng(WORKSPACE_SEED)
    return workspace_poses(NOMINAL, ROBOT.limits, ROBOT.workspace_centre, WORKSPACE_POSES, rng)


def simulate(effects: Effects, seed: tuple[int, ...], errors: Array | None = None) -> Simulated:
    """One campaign; `errors` (F,) instead of drawn ones of the true robot."""
    rng = np.random.default_rng(seed)
    shots, fitted = _rows_of(planned(), effects.pairs)
    drawn = ERROR_STD * rng.standard_normal(len(FREE_PLACES))
    before = NOMINAL.p.copy()
    before[FREE_PLACES] += drawn if errors is None else errors
    arm, first = int(rng.integers(4)), _first_after(rng, fitted)
    after = _stepped(before, effects, arm, rng)
    turned = _backlash_rad(shots.joints, rng) if effects.backlash else 0.0
    joints = shots.joints + turned
    if effects.has_rods:
        forward, shift = _eight_rods(after, effects, rng), np.zeros((len(shots), 3))
        in_base, poses = forward(joints), _poses(after, joints)
    else:
        forward = _contracted(after)
        poses = _poses(after, joints)
        begun = poses[:, :3] if after is before else _contracted(before)(joints)
        shift = _passed(effects, len(shots), first)[:, None] * (poses[:, :3] - begun)
        in_base = begun + shift
    if effects.repeatability:
        in_base = in_base + REPEATABILITY_MM * rng.uniform(-1.0, 1.0, in_base.shape)
    points = in_base - np.array(TRACKER_MM)
    if "frame" in (effects.step, effects.drift):
        shift = _passed(effects, len(shots), first)[:, None] * _any_direction(rng, 1, effects.size)
        points = points + shift
    wrong = rng.choice(fitted, effects.gross, replace=False)
    off = _any_direction(rng, effects.gross, effects.size)
    points[wrong] += (
        _along_pairs(shots, points, wrong, effects.size) if effects.along_pairs else off
    )
    stated = point_covariance_mm2(points, INSTRUMENT)
    roots = np.linalg.cholesky(stated)
    points = points + np.einsum("nij,nj->ni", roots, rng.standard_normal(points.shape))
    return Simulated(
        shots=replace(shots, points_in_tracker_mm=points, stated_covariance_mm2=stated),
        true_parameters=after[FREE_PLACES],
        forward=forward,
        covariance_mm2=_whole_covariance_mm2(stated, effects, forward, shots.joints),
        poses=poses,
        shift_mm=shift,
        step=effects.step,
        arm=arm,
        first_after=shots.numbers[first],
        gross=frozenset(shots.numbers[row] for row in wrong.tolist()),
    )


def position_error_mm(forward: Forward, identified: Kinematics) -> float:
    """Root mean square over the workspace, after the best fit of the frame."""
    poses = workspace()
    joints = identified.inverse(poses)
    modelled, true = poses[joints.found, :3], forward(joints.values[joints.found])
    a, b = modelled - modelled.mean(axis=0), true - true.mean(axis=0)
    u, _, vt = np.linalg.svd(b.T @ a)
    proper = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    left = b - a @ (u @ proper @ vt).T
    return float(np.sqrt(np.mean(np.sum(left**2, axis=1))))


def _whole(free: Array) -> Array:
    p = NOMINAL.p.copy()
    p[FREE_PLACES] = free
    return p


def _rows_of(shots: Shots, pairs: int) -> tuple[Shots, Index]:
    """Shots with so many pairs to be fitted, and the rows of these."""
    fitted = [each is ShotSet.IDENTIFICATION for each in shots.purposes]
    wanted = np.flatnonzero(~np.array(fitted) | (np.cumsum(fitted) <= 2 * pairs))
    some = shots.rows(wanted)
    return some, np.flatnonzero([each is ShotSet.IDENTIFICATION for each in some.purposes])


def _first_after(rng: np.random.Generator, fitted: Index) -> int:
    """Row of the first shot after a step: between two sessions of equal length, or anywhere."""
    place = int(rng.integers(FEWEST_BEYOND, len(fitted) - FEWEST_BEYOND + 1))
    return int(fitted[len(fitted) // 2 if rng.random() < 1.0 / 3.0 else place])


def _stepped(before: Array, effects: Effects, arm: int, rng: np.random.Generator) -> Array:
    """Parameters after a step or warming; the same array where the robot stays as it is."""
    after = before.copy()
    if effects.step == "joint":
        after[SPACE.offsets[arm]] += np.radians(effects.size) * rng.choice([-1.0, 1.0])
    elif effects.step == "length":
        after[SPACE.places(SPACE.arm_lengths)[arm]] += effects.size
    elif effects.drift == "arms":
        after[SPACE.places(SPACE.arm_lengths)] += effects.size
    else:
        return before
    return after


def _passed(effects: Effects, count: int, first: int) -> Array:
    """Part of the change that has come about at each shot, (N,).

    Between a cold robot's points and a warm one's a straight line is taken: 0.2 mm of growth bends
    it by less than 0.1 µm.
    """
    if effects.drift == "arms":
        return np.asarray(-np.expm1(-3.0 * np.linspace(0.0, 1.0, count)) / -np.expm1(-3.0))
    if effects.drift:
        return np.linspace(0.0, 1.0, count)
    return np.asarray(np.arange(count) >= first, dtype=np.float64)


def _backlash_rad(joints: Array, rng: np.random.Generator) -> Array:
    return np.asarray(0.5 * BACKLASH_RAD * rng.choice([-1.0, 1.0], joints.shape))


def _any_direction(rng: np.random.Generator, count: int, size_mm: float) -> Array:
    drawn = rng.standard_normal((count, 3))
    return np.asarray(size_mm * drawn / np.linalg.norm(drawn, axis=1, keepdims=True))


def _along_pairs(shots: Shots, points: Array, rows: Index, size_mm: float) -> Array:
    """Away from the other shot of each row's pair."""
    pairs = np.array([-1 if pair is None else pair for pair in shots.pairs])
    gaps = [points[row] - points[pairs == pairs[row]].mean(axis=0) for row in rows.tolist()]
    lines = np.reshape(gaps, (len(rows), 3))
    return np.asarray(size_mm * lines / np.linalg.norm(lines, axis=1, keepdims=True))


def _poses(p: Array, joints: Array) -> Array:
    return Kinematics(NOMINAL.mechanism, p).forward(joints).values_or_raise()


def _contracted(p: Array) -> Forward:
    return lambda joints: _poses(p, joints)[:, :3]


def _eight_rods(p: Array, effects: Effects, rng: np.random.Generator) -> Forward:
    true = Kinematics(NOMINAL.mechanism, p)
    flat = true.flat()
    build = Build(
        plate_joints_mm=np.array(SECTION.plate_joints_mm),
        rod_spacing_mm=SECTION.rod_spacing_mm,
        rod_errors_mm=effects.rods_mm * rng.standard_normal((4, 2)),
        axis_tilts_rad=1e-3 * effects.axes_mrad * rng.standard_normal(4),
    )
    rods = EightRods(geometry_of({name: flat[name] for name in FLAT_NAMES}), build)
    offset = np.array(SECTION.reflector.offset_mm)

    def forward(joints: Array) -> Array:
        near = true.forward(joints).values_or_raise()
        points = []
        for row, pose in zip(joints, near, strict=True):
            guess = Plate(np.array([*pose[:3], 0.0, 0.0, 0.0, pose[3]]))
            plate = rods.settle(row, 0.0, guess)[0]
            points.append(plate.position_mm + plate.rotation @ offset)
        return np.array(points)

    return forward


def _whole_covariance_mm2(
    stated_mm2: Array, effects: Effects, forward: Forward, joints: Array
) -> Array:
    whole = stated_mm2
    if effects.repeatability:
        whole = whole + REPEATABILITY_MM**2 / 3.0 * np.eye(3)
    if effects.backlash:
        steps = DIFFERENCE_RAD * np.eye(joints.shape[1])
        moved = [forward(joints + step) - forward(joints - step) for step in steps]
        by_joints = np.stack(moved, axis=-1) / (2.0 * DIFFERENCE_RAD)
        through = by_joints @ by_joints.swapaxes(1, 2)
        whole = whole + (0.5 * BACKLASH_RAD) ** 2 * through
    return np.asarray(whole)
