"""Validation: errors of the commanded robot, each with the instrument's uncertainty.

In come the accepted shots of one series: each has a commanded pose, a measured point, and a
purpose that says to which test it belongs. The tests are those of the paper (section IV.E), and
AP and RP of ISO 9283:

- distances of pairs, commanded and measured: they need no frame;
- the largest motion of the point while only the platform should turn;
- straightness of a line along each axis, whichever way it points in space;
- repeatability: the sphere about the visits to one pose;
- the cube of ISO 9283: five poses, each visited from one direction.

Each figure has a standard uncertainty along its own error: the instrument's, and that of the
robot's scatter, since limits and comparisons are about the robot and not about one visit. Beside
that no model of the robot is used. Vectors are in the base frame as fitted to the commanded points
(paper eq. 25), or, with too few points, in the tracker's axes.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from pydantic import JsonValue

from campaigns.arrays import AXES, Array, Index
from campaigns.evaluation.measured_lengths import (
    MeasuredLength,
    PointNoise,
    largest_length,
    largest_of,
    unsigned_excess_mm,
)
from campaigns.evaluation.robot_scatter import RobotScatter
from campaigns.fit import rigid_transforms
from campaigns.fit.error_sources import SCATTER_TOLERANCE_MM
from campaigns.fit.rigid_transforms import away_from_mean, length_with_std
from campaigns.fit.tracker_noise import TrackerUncertainty, common_distance_variance_mm2
from campaigns.shots.shot_sets import PairRows, ShotSet
from campaigns.shots.shots import Shots

SET_OF: Mapping[str, ShotSet] = {
    "distances": ShotSet.VALIDATION,
    "rotation": ShotSet.ROTATION,
    "straightness": ShotSet.STRAIGHTNESS,
    "repeatability": ShotSet.REPEATABILITY,
    "iso9283": ShotSet.ISO_CUBE,
}
"""Shots of each test, by the word on the command line: the paper's (section IV.E), and a cube."""
BY_DEFAULT = tuple(name for name in SET_OF if name != "iso9283")
SAME_POSE_SHARE = 0.1
"""Commanded places within this part of the cube are one pose's: as read by encoders they differ."""
CUBE_FIGURES = ("pose accuracy AP, worst", "pose repeatability RP, worst")
RP_DEVIATIONS = 3.0
"""Standard deviations in RP."""
NO_AXIS = -1
SAME_PLACE_MM = 1e-6
SAME_PLACE_SHARE = 0.01
"""Below this, or this part of the largest change, a commanded coordinate has not changed: poses of
shots measured elsewhere are computed from encoders."""
SHOTS_OF_A_LINE = 3
OUTERMOST_SCATTER = 0.5
"""Standard deviation of the outermost of many visits' distances, over that of a coordinate."""


@dataclass(frozen=True, slots=True, eq=False)
class DistanceTest:
    """Pairs whose distance was commanded and measured, (M,) each."""

    pairs: tuple[int, ...]
    commanded_mm: Array
    measured_mm: Array
    instrument_mm: Array
    """1 σ by the instrument."""
    robot_mm: Array
    """1 σ by the robot's scatter."""
    dof: float = math.inf
    """Degrees of freedom of the robot's scatter."""

    @property
    def errors_mm(self) -> Array:
        """Commanded minus measured distances."""
        return np.asarray(self.commanded_mm - self.measured_mm)

    @property
    def mean(self) -> MeasuredLength:
        """Mean error without signs.

        The robot's scatter is reduced by averaging. The instrument's uncertainty is not: its errors
        at points near each other are alike.
        """
        errors_mm = self.errors_mm
        instrument_mm = float(self.instrument_mm.mean())
        instrument_mm = math.hypot(instrument_mm, unsigned_excess_mm(errors_mm, self.robot_mm))
        return self._mean(instrument_mm)

    @property
    def comparable_mean(self) -> MeasuredLength:
        """Mean error without signs, in a comparison with another validation of the same pairs.

        An error of the instrument that all distances share is the same in both, so averaging is
        credited to the instrument too.
        """
        return self._mean(_std_of_mean(self.instrument_mm))

    def _mean(self, instrument_mm: float) -> MeasuredLength:
        value_mm = float(np.abs(self.errors_mm).mean())
        return MeasuredLength(value_mm, instrument_mm, _std_of_mean(self.robot_mm), self.dof)

    @property
    def largest(self) -> MeasuredLength:
        """Largest error without sign."""
        size_mm, count = np.abs(self.errors_mm), len(self.pairs)
        return largest_of(size_mm, self.instrument_mm, self.robot_mm, self.dof, count)

    def with_scatter(self, scatter_mm: float) -> "DistanceTest":
        """Return the test with another scatter of the robot's points, known as a bound."""
        of_pairs = np.full(len(self.pairs), math.sqrt(2.0) * scatter_mm)
        return replace(self, robot_mm=of_pairs, dof=math.inf)


@dataclass(frozen=True, slots=True, eq=False)
class LineTest:
    """Commanded straight line along an axis, with its points (N, 3)."""

    axis: str
    commanded_mm: Array
    points_mm: Array
    away_mm: Array
    """Vectors from the best line to the measured points, (N, 3)."""
    straightness: MeasuredLength
    """Largest distance from the best line."""

    @property
    def along_mm(self) -> Array:
        """Commanded place along the line, (N,)."""
        return np.asarray(self.commanded_mm[:, AXES.index(self.axis)])


@dataclass(frozen=True, slots=True, eq=False)
class RotationTest:
    """Motion of the point in a rotation of the platform that should leave it in its place."""

    turn_rad: Array
    """Commanded rotation, (N,)."""
    about: Index
    """Number of the turn that it is of, (N,): 0 of platforms with one."""
    away_mm: Array
    """Points from their mean, (N, 3)."""
    moved: MeasuredLength
    """Largest distance between any two points."""


@dataclass(frozen=True, slots=True, eq=False)
class RepeatabilityTest:
    """Points (N, 3) of repeated visits to one commanded point (3,)."""

    commanded_mm: Array
    points_mm: Array
    radius: MeasuredLength
    """Radius of the sphere about their mean."""
    instrument_mm2: Array
    """Mean covariance of the points by the instrument, (3, 3): averaging does not reduce it."""
    in_base: bool
    """Whether the points are in the base frame, not in the tracker's axes."""

    @property
    def away_mm(self) -> Array:
        """Points from their mean, (N, 3)."""
        return away_from_mean(self.points_mm)

    @property
    def scatter_mm(self) -> float:
        """Standard deviation of one coordinate about the mean; the tracker's noise is in it."""
        away = self.away_mm
        return float(np.sqrt(np.sum(away**2) / (3 * (len(away) - 1))))

    @property
    def accuracy(self) -> MeasuredLength | None:
        """Distance of their mean from the commanded point (AP); None without a base frame.

        Its uncertainty contains the scatter of the mean and the instrument's uncertainty.
        """
        # The mean scatters less by √N. The instrument's part does not: its errors at one place are
        # the same at every visit.
        away = self.points_mm.mean(axis=0) - self.commanded_mm
        length = float(np.linalg.norm(away))
        if not self.in_base:
            return None
        of_mean = self._scatter_of_mean_mm(away / length) if length > 0.0 else 0.0
        _, instrument_mm = length_with_std(away, self.instrument_mm2)
        return MeasuredLength(length, instrument_mm, of_mean, len(self.points_mm) - 1)

    @property
    def components(self) -> tuple[MeasuredLength, ...] | None:
        """AP along x, y and z, mean minus commanded; None without a base frame."""
        away = self.points_mm.mean(axis=0) - self.commanded_mm
        instrument_mm = np.sqrt(np.diag(self.instrument_mm2))
        axes = zip(away.tolist(), instrument_mm.tolist(), np.eye(3), strict=True)
        lengths = tuple(
            MeasuredLength(mm, std_mm, self._scatter_of_mean_mm(axis), len(self.points_mm) - 1)
            for mm, std_mm, axis in axes
        )
        return lengths if self.in_base else None

    def _scatter_of_mean_mm(self, direction: Array) -> float:
        along = self.points_mm @ direction
        return float(along.std(ddof=1) / np.sqrt(len(along)))

    @property
    def rp(self) -> MeasuredLength:
        """l̄ + 3 S of their distances from their mean: RP for visits from one direction.

        The instrument's noise is part of the spread and enlarges it; the uncertainty is that of a
        finite sample.
        """
        lengths, count = np.linalg.norm(self.away_mm, axis=1), len(self.points_mm)
        deviation = float(lengths.std(ddof=1))
        value_mm = float(lengths.mean()) + RP_DEVIATIONS * deviation
        return MeasuredLength(value_mm, deviation * _relative_std_of_rp(count))


@dataclass(frozen=True, slots=True, eq=False)
class ValidationResult:
    """Results of a validation; None or empty for a test that was not run."""

    distances: DistanceTest | None
    absolute_mm: Array | None
    """Distances of the pairs' points from where they were commanded, the frame fitted, (N,)."""
    rotation: RotationTest | None
    lines: tuple[LineTest, ...]
    repeatability: RepeatabilityTest | None
    cube: tuple[RepeatabilityTest, ...] = ()
    """Visits from one direction to each of ISO 9283's poses, P1 first."""
    scatter: RobotScatter = field(default_factory=RobotScatter)
    """Scatter of the robot that is in the uncertainties."""
    series: Mapping[str, int] = field(default_factory=dict)
    """Series in which each test was made, by the test's name."""

    def over(self, older: "ValidationResult") -> "ValidationResult":
        """Return this result with the tests of an older validation that it lacks."""
        return ValidationResult(
            self.distances or older.distances,
            self.absolute_mm if self.distances else older.absolute_mm,
            self.rotation or older.rotation,
            self.lines or older.lines,
            self.repeatability or older.repeatability,
            self.cube or older.cube,
            self.scatter if self.scatter.is_known else older.scatter,
            {**older.series, **self.series},
        )

    @property
    def series_in_words(self) -> str:
        """Series of each test; empty where all are of one."""
        if len(set(self.series.values())) < 2:
            return ""
        return ", ".join(f"{name} of series {number}" for name, number in self.series.items())

    def line(self, axis: str) -> LineTest | None:
        """Return the line along an axis."""
        return next((line for line in self.lines if line.axis == axis), None)

    def figures(self) -> dict[str, MeasuredLength | None]:
        """Return all that limits may be asked for, by the names on screen and page."""
        distances, repeated = self.distances, self.repeatability
        lines = {axis: self.line(axis) for axis in AXES}
        return {
            "distances, mean error": distances.mean if distances else None,
            "distances, largest error": distances.largest if distances else None,
            "rotation": self.rotation.moved if self.rotation else None,
            **{
                f"straightness along {axis}": line.straightness if line else None
                for axis, line in lines.items()
            },
            "repeatability, radius of the sphere": repeated.radius if repeated else None,
            **dict(zip(CUBE_FIGURES, self.worst_of_cube, strict=True)),
        }

    @property
    def worst_of_cube(self) -> tuple[MeasuredLength | None, MeasuredLength | None]:
        """Largest AP and RP of the poses, each chosen with its U; None where not measured."""
        # The worst by value + U, since the limit is compared with that sum. AP and RP may be worst
        # at different poses.
        return _worst(pose.accuracy for pose in self.cube), _worst(pose.rp for pose in self.cube)

    def comparable_figures(self) -> dict[str, MeasuredLength | None]:
        """Return the figures with their uncertainty in a comparison with another validation.

        If the robot's scatter is unknown, it counts with the largest that a robot may have. The
        uncertainty of the mean error of N distances is divided by √N.
        """
        figures, distances = self.figures(), self.distances
        if not self.scatter.is_known:
            of_point, of_two = SCATTER_TOLERANCE_MM, math.sqrt(2.0) * SCATTER_TOLERANCE_MM
            bounds = {f"straightness along {axis}": of_point for axis in AXES}
            for name, bound_mm in (bounds | {"rotation": of_two}).items():
                length = figures[name]
                figures[name] = length and length.with_scatter(bound_mm)
            distances = distances and distances.with_scatter(of_point)
        if distances is not None:
            figures["distances, mean error"] = distances.comparable_mean
            figures["distances, largest error"] = distances.largest
        return figures

    def further_figures_mm(self) -> dict[str, float | None]:
        """Return the further figures, for which there are no limits."""
        repeated, absolute = self.repeatability, self.absolute_mm
        return {
            "repeatability, l̄ + 3 S": repeated.rp.value_mm if repeated else None,
            "absolute position error, mean": None if absolute is None else absolute.mean(),
            "absolute position error, largest": None if absolute is None else absolute.max(),
        }

    def document(self) -> dict[str, JsonValue]:
        """Return the result as `validate --json` prints it."""
        straight: dict[str, JsonValue] = {
            line.axis: line.straightness.value_mm for line in self.lines
        }
        return {
            "distances_mm": None if self.distances is None else _distances(self.distances),
            "rotation_mm": None if self.rotation is None else self.rotation.moved.value_mm,
            "straightness_mm": straight or None,
            "repeatability": None if self.repeatability is None else _repeated(self.repeatability),
            "frame_mm": None if self.absolute_mm is None else _absolute(self.absolute_mm),
            "iso9283": [_pose(f"P{n}", pose) for n, pose in enumerate(self.cube, 1)] or None,
        }


def _distances(test: DistanceTest) -> dict[str, JsonValue]:
    return {"mean_abs": test.mean.value_mm, "max_abs": test.largest.value_mm}


def _repeated(test: RepeatabilityTest) -> dict[str, JsonValue]:
    approaches = len(test.points_mm)
    return {"radius_mm": test.radius.value_mm, "rp_mm": test.rp.value_mm, "approaches": approaches}


def _pose(name: str, test: RepeatabilityTest) -> dict[str, JsonValue]:
    """Return AP, its components and RP of one pose, each with U."""
    figures = {"ap": test.accuracy, "rp": test.rp}
    components = zip(AXES, test.components or (), strict=False)
    figures |= {f"ap_{axis}": component for axis, component in components}
    measured = {key: length for key, length in figures.items() if length}
    return {
        "pose": name,
        "commanded_mm": test.commanded_mm.tolist(),
        "visits": len(test.points_mm),
        **{f"{key}_mm": length.value_mm for key, length in measured.items()},
        **{f"{key}_u_mm": length.expanded_uncertainty_mm for key, length in measured.items()},
    }


def _absolute(away_mm: Array) -> dict[str, JsonValue]:
    return {"mean": float(away_mm.mean()), "max": float(away_mm.max())}


def evaluate_validation(
    shots: Shots,
    instrument: TrackerUncertainty,
    series: int = 0,
    scatter: RobotScatter | None = None,
) -> ValidationResult:
    """Return the result of the accepted shots of a validation series.

    `instrument` stands in for shots without a stated uncertainty. `scatter` is the robot's, by
    default that of repeated visits among the shots. The frame is fitted to the pairs, or to all
    shots where there are too few pairs.
    """
    # 1. Covariances of each point, and the part of a pair's variance by errors that all shots have
    #    in common (scale, axes): that part needs the points as the tracker saw them.
    # 2. Bring points and covariances into the base frame, if it can be fitted. The pairs are spread
    #    over the workspace; lines and repeated poses would pull the frame towards their few places.
    commanded = np.column_stack([shots.commanded_points_mm, shots.commanded[:, 3:]])
    levers_mm = shots.commanded_points_mm - shots.commanded[:, :3]
    points = shots.points_in_tracker_mm
    covariance, pairs = shots.covariance_mm2(instrument), shots.rows_of(ShotSet.VALIDATION)
    scatter = scatter_of_visits(shots) if scatter is None else scatter
    whole = shots.whole_pairs(ShotSet.VALIDATION)
    common = common_distance_variance_mm2(points, instrument, *whole.rows.T)
    of_pairs = rigid_transforms.fitted_frame(points[pairs], commanded[pairs, :3])
    frame = of_pairs or rigid_transforms.fitted_frame(points, commanded[:, :3])
    if frame is not None:
        points = frame.apply(points)
        covariance = frame.rotation @ covariance @ frame.rotation.T
    of_robot = scatter.covariance_mm2(shots)
    if frame is None:  # axes of the base are unknown: the worst direction stands for all
        of_robot = np.linalg.eigvalsh(of_robot)[:, -1, None, None] * np.eye(3)
    noise = PointNoise(covariance, of_robot, scatter.dof)

    rotation, lines, repeated, cube = map(
        shots.rows_of,
        (ShotSet.ROTATION, ShotSet.STRAIGHTNESS, ShotSet.REPEATABILITY, ShotSet.ISO_CUBE),
    )
    in_base = frame is not None
    absolute_mm = np.asarray(np.linalg.norm(points[pairs] - commanded[pairs, :3], axis=1))
    result = ValidationResult(
        distance_test(whole, commanded, points, noise, common),
        absolute_mm if in_base and len(pairs) else None,
        rotation_test(commanded[rotation], points[rotation], noise[rotation], levers_mm[rotation]),
        line_tests(commanded[lines], points[lines], noise[lines]),
        repeatability_test(commanded[repeated], points[repeated], noise[repeated], in_base=in_base),
        cube_tests(commanded[cube], points[cube], noise[cube], in_base=in_base),
        scatter,
    )
    tests = (result.distances, result.rotation, result.lines, result.repeatability, result.cube)
    return replace(
        result, series={name: series for name, test in zip(SET_OF, tests, strict=True) if test}
    )


def scatter_of_visits(shots: Shots) -> RobotScatter:
    """Return the robot's scatter by repeated visits among shots: to one pose, or to a cube's."""
    points, one_pose = shots.points_in_tracker_mm, shots.rows_of(ShotSet.REPEATABILITY)
    cube = shots.rows_of(ShotSet.ISO_CUBE)
    if len(one_pose) > 1:
        return RobotScatter.of_visits([points[one_pose]])
    return RobotScatter.of_visits(
        [points[cube[rows]] for rows in _rows_by_pose(shots.commanded_points_mm[cube])]
    )


def latest_of_each_test(oldest_first: Iterable[ValidationResult]) -> ValidationResult | None:
    """Join the validations of one stage: the latest of each test counts; None without any."""
    latest = None
    for result in oldest_first:
        latest = result if latest is None else result.over(latest)
    return latest


def distance_test(
    pairs: PairRows,
    commanded: Array,
    points_mm: Array,
    noise: PointNoise,
    common_mm2: Array | float = 0.0,
) -> DistanceTest | None:
    """Return distances of the whole pairs; None when there is none.

    As in the other tests `commanded` is (N, t), in mm and rad, and the points are (N, 3);
    `common_mm2` is the pairs' variance by what all shots have in common.
    """
    if not pairs.numbers:
        return None
    first, second = pairs.rows.T
    direction, of_pairs = (
        rigid_transforms.directions(points_mm, first, second), noise.between(first, second)
    )  # fmt: skip
    instrument_mm2, robot_mm2 = (
        np.einsum("mi,mij,mj->m", direction, covariance, direction)
        for covariance in (of_pairs.instrument_mm2, of_pairs.robot_mm2)
    )
    return DistanceTest(
        pairs.numbers,
        rigid_transforms.distances_mm(commanded[:, :3], first, second),
        rigid_transforms.distances_mm(points_mm, first, second),
        np.sqrt(instrument_mm2 + common_mm2),
        np.sqrt(robot_mm2),
        noise.dof,
    )


def line_tests(commanded: Array, points_mm: Array, noise: PointNoise) -> tuple[LineTest, ...]:
    """Return every line of at least three shots, in the order x, y, z."""
    along, lines = line_axes(commanded[:, :3]), []
    for place, axis in enumerate(AXES):
        rows = np.flatnonzero(along == place)
        if len(rows) >= SHOTS_OF_A_LINE:
            away = rigid_transforms.away_from_best_line(points_mm[rows])
            straightness = largest_length(away, noise[rows])
            line = LineTest(axis, commanded[rows, :3], points_mm[rows], away, straightness)
            lines.append(line)
    return tuple(lines)


def rotation_test(
    commanded: Array, points_mm: Array, noise: PointNoise, levers_mm: Array | float = 0.0
) -> RotationTest | None:
    """Return the motion of the point while only the platform turns; None for one shot, or no turn.

    `levers_mm` (N, 3) are those of the reflector from the controlled point, which turn with it.
    """
    if len(points_mm) < 2 or commanded.shape[1] == len(AXES):
        return None
    points_mm = np.asarray(points_mm - levers_mm)
    first, second = np.triu_indices(len(points_mm), 1)
    moved = largest_length(points_mm[second] - points_mm[first], noise.between(first, second))
    turns = commanded[:, 3:]
    about = np.abs(turns).argmax(axis=1)
    turn_rad = np.take_along_axis(turns, about[:, None], axis=1)[:, 0]
    return RotationTest(turn_rad, about, away_from_mean(points_mm), moved)


def repeatability_test(
    commanded: Array, points_mm: Array, noise: PointNoise, *, in_base: bool
) -> RepeatabilityTest | None:
    """Return the sphere about the mean of points at one commanded pose; None for fewer than two."""
    if len(points_mm) < 2:
        return None
    # The robot's scatter is what the radius measures: its part is that of a finite sample.
    away_mm = rigid_transforms.away_from_mean(points_mm)
    outermost = int(np.argmax(np.linalg.norm(away_mm, axis=1)))
    radius = MeasuredLength(*length_with_std(away_mm[outermost], noise.instrument_mm2[outermost]))
    visits = RobotScatter.of_visits([points_mm])
    radius = replace(radius, robot_mm=OUTERMOST_SCATTER * visits.point_mm, dof=visits.dof)
    at_mm, instrument_mm2 = commanded[:, :3].mean(axis=0), noise.instrument_mm2.mean(axis=0)
    return RepeatabilityTest(at_mm, points_mm, radius, instrument_mm2, in_base)


def cube_tests(
    commanded: Array, points_mm: Array, noise: PointNoise, *, in_base: bool
) -> tuple[RepeatabilityTest, ...]:
    """Return visits to each of ISO 9283's poses: P1 in the middle, the others about z.

    Poses of fewer than two visits are left out.
    """
    # The pose in the middle of their extent is P1, the others follow by their angle about z.
    places_mm = commanded[:, :3]
    if not len(places_mm):
        return ()
    middle, near_mm = _middle_mm(places_mm), _near_mm(places_mm)
    tests = [
        repeatability_test(commanded[rows], points_mm[rows], noise[rows], in_base=in_base)
        for rows in _rows_by_pose(places_mm)
    ]

    def order(test: RepeatabilityTest) -> tuple[bool, float]:
        x_mm, y_mm, _ = away = test.commanded_mm - middle
        return bool(np.linalg.norm(away) > near_mm), float(np.arctan2(y_mm, x_mm))

    return tuple(sorted(filter(None, tests), key=order))


def _middle_mm(places_mm: Array) -> Array:
    return np.asarray(0.5 * (places_mm.min(axis=0) + places_mm.max(axis=0)))


def _near_mm(places_mm: Array) -> float:
    """Return the distance within which commanded places (N, 3) are one pose's."""
    return SAME_POSE_SHARE * float(np.ptp(places_mm, axis=0).max()) + SAME_PLACE_MM


def _rows_by_pose(places_mm: Array) -> list[Index]:
    """Return the rows of the visits to each pose, by commanded places (N, 3)."""
    # Shots come without a pose's number, and imported ones have commanded places computed from
    # encoders, which differ a little at each visit. So group them: take the first that remains,
    # collect all near it, and go on with the others.
    groups, remaining = list[Index](), np.arange(len(places_mm))
    near_mm = _near_mm(places_mm) if len(places_mm) else 0.0
    while len(remaining):
        away_mm = places_mm[remaining] - places_mm[remaining[0]]
        is_near = np.linalg.norm(away_mm, axis=1) <= near_mm
        groups.append(remaining[is_near])
        remaining = remaining[~is_near]
    return groups


def line_axes(commanded_mm: Array) -> Index:
    """Return the axis (0, 1, 2) of the line to which each commanded point belongs, or -1, (N,).

    Points (N, 3) come line by line, and along each line only one coordinate changes: a point is of
    the line along the one axis on which it differs from its predecessor. -1: a point of no line.
    """
    # A way that changes several coordinates, or none, separates two lines. The first point of a
    # line gets the axis that the second one shows, unless it is the last of the line before.
    changes = np.abs(np.diff(commanded_mm, axis=0))
    smallest = np.maximum(SAME_PLACE_MM, SAME_PLACE_SHARE * changes.max(axis=1, keepdims=True))
    steps = changes > smallest
    axes = np.full(len(commanded_mm), NO_AXIS, dtype=np.intp)
    for row, changed in enumerate(steps, start=1):
        if np.count_nonzero(changed) == 1:
            axes[row] = int(np.argmax(changed))
            if axes[row - 1] == NO_AXIS:
                axes[row - 1] = axes[row]
    return axes


def _relative_std_of_rp(count: int) -> float:
    """Return the standard uncertainty of l̄ + 3 S of `count` distances, over S."""
    # Distances from a mean are half-normal, Rayleigh or Maxwell distributed for scatter along one,
    # two or three axes: skew (γ) and peaked (κ, excess), so that l̄ and S go up together.
    # Var l̄ = S²/n, Var S = S²/(2(n − 1)) · (1 + κ/2), Cov(l̄, S) = γ S²/(2n). Half-normal ones have
    # the largest moments, γ = 0.995 and κ = 0.87; 1 is on the safe side of all.
    skewness, excess = 1.0, 1.0
    of_deviation = (1.0 + 0.5 * excess) / (2.0 * (count - 1))
    together = RP_DEVIATIONS * skewness / count
    return float(np.sqrt(1.0 / count + RP_DEVIATIONS**2 * of_deviation + together))


def _std_of_mean(std_mm: Array) -> float:
    """Return 1 σ of the mean of independent values with these 1 σ, (M,)."""
    return float(np.sqrt(np.sum(std_mm**2))) / len(std_mm)


def _worst(figures: Iterable[MeasuredLength | None]) -> MeasuredLength | None:
    """Return the figure that reaches farthest with the U of the largest of them; None without."""
    measured = [figure for figure in figures if figure is not None]
    of_all = [replace(figure, count=len(measured)) for figure in measured]
    return max(of_all, key=lambda figure: figure.upper_mm, default=None)
