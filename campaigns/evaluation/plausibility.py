"""Plausibility of measured shots and of identified parameters, judged by the nominal robot.

A fit cannot distinguish points in metres from a robot a thousand times smaller, and hold-out pairs
agree, being in the same unit. Only the nominal robot contradicts it: its positions at the recorded
joints must be the measured points up to a rigid motion, nearly so even before any fit. How nearly
follows from the tolerances of the robot's parameters (`right_misfit`).

A misfit is doubted from `COVERAGE` times that on, and what takes as much off a misfit or a distance
is the cause.

If they are not, causes are fitted, the simplest first, and one is named only if no more remains
then than with shots that were read rightly:

1. another reading: unit, mirrored frame, half of the plate, radians, signs or order of the joints
   (`readings`). Where the robot's symmetry lets several fit alike, the tracker's rough place
   decides, or they are all named;
2. a tracker that stood elsewhere from some shots on: rigid pieces fit (`pieces`);
3. another scale of lengths, and a map of the columns to joints: order, factor and zero
   (`joint_maps`).

Zeros, factors and scales that are less than wrong are for the fit itself to find.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.errors import ShotsInvalid
from campaigns.evaluation.decision import COVERAGE
from campaigns.evaluation.joint_maps import Causes, JointMap, simplest_map
from campaigns.evaluation.pieces import (
    FEWEST_SHOTS,
    JUDGED_SHARE,
    greater_part,
    rigid_pieces,
    similarity,
    similarity_fit,
    spread_mm,
)
from campaigns.evaluation.readings import MIRRORED, Reading, each_reading, halves, joint_readings
from campaigns.files.wording import listed
from campaigns.fit.rigid_transforms import away_from_mean, frame_jacobian
from campaigns.kinematics.model import Kinematics
from campaigns.kinematics.parameters import ParameterTable
from campaigns.robots.schema import Tolerance
from campaigns.shots.point_words import MM_PER_UNIT, LengthUnit
from campaigns.shots.shots import OF_SESSIONS, Shots
from drivers.values import DISTANCE, JOINT_ANGLE, PART_TEMPERATURE, SIGMA, TEMPERATURE, Vector3

SHOTS_TO_TRY = 24
"""Shots by which other readings are tried: hundreds of readings of all shots would take long."""
IMPOSSIBLE_MISFIT = 0.3
"""Misfit that no robot of this kind has: below it the robot may be far off its drawing."""
ROUGH_PLACE_MM = 1000.0
"""Error of a rough place of the tracker: below it the place is not contradicted."""
TOLERANCE = Tolerance()
"""Tolerances of a robot that states none."""


def beyond_tolerance(
    space: ParameterTable, tolerance: Tolerance, changes: Mapping[str, float]
) -> Iterator[str]:
    """Return changes (mm and deg, by name) beyond the tolerance, the largest first, in words."""
    limits = {name: tolerance.of(space[name]) for name in changes}
    # "not … <=" catches NaN too, which compares false with everything.
    beyond = {name: change for name, change in changes.items() if not abs(change) <= limits[name]}
    for name in sorted(beyond, key=lambda key: -abs(beyond[key]) / limits[key]):
        sign = space[name].sign
        yield f"{name} changed by {beyond[name]:+.4g}{sign}, tolerance ± {limits[name]:g}{sign}"


def check_shots(
    nominal: Kinematics,
    shots: Shots,
    where: str,
    place_mm: Vector3 | None = None,
    unit: LengthUnit = "mm",
    tolerance: Tolerance = TOLERANCE,
) -> None:
    """Raise `ShotsInvalid`, naming the cause, for shots that cannot be this robot's.

    `where` names the file or series. `place_mm` is the tracker's rough place in the base frame: it
    alone distinguishes arms where the robot is symmetrical about its axis. `unit`: of the file as
    it was read. `tolerance`: of the robot's parameters.
    """
    robot = _Robot(nominal, tolerance)
    _check_joints(robot, shots, where)
    _check_reading(robot, shots, where, place_mm, unit)
    _check_values(shots, where)


def check_distances(
    nominal: Kinematics, shots: Shots, limit_mm: float, where: str, tolerance: Tolerance = TOLERANCE
) -> None:
    """Raise `ShotsInvalid` for a point farther than a gate from where the nominal robot puts it.

    A run has this gate for every shot; imported shots get it here, after the best rigid fit of the
    greater part of them.
    """
    robot = _Robot(nominal, tolerance)
    modelled = robot.modelled(shots, np.arange(len(shots)))
    rows, positions, points = modelled.rows, modelled.positions, modelled.points
    if len(rows) < FEWEST_SHOTS:
        return
    part = greater_part(positions, points, scaled=False)
    _, residuals = similarity(positions, points, part, scaled=False)
    off_mm = np.linalg.norm(residuals, axis=1)
    worst = int(np.argmax(off_mm))
    if off_mm[worst] > limit_mm:
        # what holds for many shots is no error of this one
        _check_stations(robot, shots, where, limit_mm)
        misfit = np.linalg.norm(residuals[part]) / np.linalg.norm(away_from_mean(points[part]))
        if misfit > robot.plausible_misfit(shots.joints):
            _check_maps(robot, shots.rows(_to_try(len(shots))), where, is_possible=True)
        raise ShotsInvalid(
            f"{where}: shot {shots.numbers[rows[worst]]}: its point is {off_mm[worst]:.0f} mm from "
            f"where the nominal robot puts it, limit {limit_mm:g} mm",
            remedy="a wrong target or wrong joints: correct the row or leave it out; a robot that "
            "is so far off needs a larger gate.distance_mm",
        )


@dataclass(frozen=True, slots=True, eq=False)
class _Robot:
    """Nominal robot, and how far its parameters may be from nominal."""

    nominal: Kinematics
    tolerance: Tolerance

    # An error that is anywhere within its tolerance has the variance of a uniform distribution (GUM
    # 4.3.7). To first order it moves the points by its column of the Jacobian; what a motion of the
    # frame or a scale of lengths explains of that is no misfit. Half of the shots move less than
    # the median: a few near a singular pose do not decide.
    def right_misfit(self, joints: Array) -> float:
        """Return the misfit of robots within their tolerances at joints (N, n), rad and mm.

        It is in parts of the points' spread; 0 if the robot cannot take a good part of the joints.
        """
        table = self.nominal.mechanism.parameters
        joints = joints[_to_try(len(joints))]
        solution = self.nominal.forward(joints)
        solved = solution.is_solved
        joints, poses = joints[solved], solution.values[solved]
        if len(poses) < max(FEWEST_SHOTS, JUDGED_SHARE * len(solved)):
            return 0.0
        count = len(table.names)
        limits = np.array([self.tolerance.of(table[name]) for name in table.names])
        std = limits * table.file_unit[:count] / math.sqrt(3.0)
        try:
            rows = self.nominal.point_jacobian(joints, poses)[..., :count] * std
        except np.linalg.LinAlgError:
            return 0.0
        positions = away_from_mean(self.nominal.points(poses))
        moved = np.concatenate([frame_jacobian(positions), positions[..., None]], axis=2)
        frame = np.linalg.qr(moved.reshape(-1, moved.shape[2]))[0]
        rows = rows.reshape(-1, count)
        off = (rows - frame @ (frame.T @ rows)).reshape(len(poses), -1)
        return float(np.sqrt(np.median(np.sum(off**2, axis=1)))) / spread_mm(positions)

    def plausible_misfit(self, joints: Array) -> float:
        """Return the misfit up to which shots with joints (N, n) are not doubted."""
        return min(COVERAGE * self.right_misfit(joints), 1.0 / COVERAGE)

    def modelled(self, shots: Shots, rows: Index) -> "_Modelled":
        """Return those of some rows whose joints the robot can take, with their points."""
        poses = self.nominal.forward(shots.joints[rows])
        points = shots.points_in_tracker_mm[rows]
        usable = poses.is_solved & np.isfinite(points).all(axis=1)
        return _Modelled(rows[usable], self.nominal.points(poses.values[usable]), points[usable])


@dataclass(frozen=True, slots=True, eq=False)
class _Modelled:
    """Rows of shots, where the nominal robot puts their points, and where these were measured."""

    rows: Index
    positions: Array
    """In the base frame (M, 3)."""
    points: Array
    """In the tracker's frame (M, 3)."""


def _check_joints(robot: _Robot, shots: Shots, where: str) -> None:
    """Raise `ShotsInvalid` for angles that no encoder in degrees has, counts by their factor."""
    for place, axis in enumerate(robot.nominal.mechanism.joints):
        beyond = np.abs(shots.joints[:, place]) > math.radians(JOINT_ANGLE.most)
        if axis.is_revolute and beyond.any():
            if np.count_nonzero(beyond) >= FEWEST_SHOTS:  # fewer are single wrong rows
                _check_maps(robot, shots.rows(_to_try(len(shots))), where)
            row = int(np.argmax(beyond))
            raise ShotsInvalid(
                f"{where}: shot {shots.numbers[row]}: joint {axis.column} is "
                f"{axis.to_file(float(shots.joints[row, place])):.6g}°, "
                f"limit ± {JOINT_ANGLE.most:g}°",
                remedy="give encoder angles in degrees, not counts, and of one turn",
            )


def _check_values(shots: Shots, where: str) -> None:
    """Raise `ShotsInvalid` for a distance, σ or temperature outside of what instruments measure."""
    far_mm = np.linalg.norm(shots.points_in_tracker_mm, axis=1)
    sigma_mm = np.sqrt(np.einsum("nii->n", shots.stated_covariance_mm2))
    air = shots.temperature_degC
    for values, bounds, what in (
        (far_mm, DISTANCE, "its point's distance from the tracker"),
        (sigma_mm, SIGMA, "the stated σ of its point"),
        (air, TEMPERATURE, "its air's temperature"),
        (shots.part_temperature_degC, PART_TEMPERATURE, "its parts' temperature"),
    ):
        wrong = np.isfinite(values) & ((values < bounds.least) | (values > bounds.most))
        if wrong.any():
            row = int(np.argmax(wrong))
            raise ShotsInvalid(
                f"{where}: shot {shots.numbers[row]}: {what} is {values[row]:.6g}{bounds.unit}, "
                f"must be {bounds.least:g} to {bounds.most:g}",
                remedy="correct the row, or the unit of its column",
            )


def _check_reading(
    robot: _Robot, shots: Shots, where: str, place_mm: Vector3 | None, unit: LengthUnit
) -> None:
    """Raise `ShotsInvalid` where another reading fits far better, or what is written not at all."""
    # 1. Compare the places of the reflector, with all else as it is written.
    # 2. If what is written fits, only the tracker's place can contradict it.
    # 3. Otherwise fit causes to some of the shots, and name the simplest that explain them.
    # 4. In between the shots pass: a robot that is far off its drawing is what the fit is for.
    nominal, points = robot.nominal, shots.points_in_tracker_mm
    if len(points) < FEWEST_SHOTS:
        return
    plausible = robot.plausible_misfit(shots.joints)
    spread = np.linalg.svd(away_from_mean(points), compute_uv=False)
    if COVERAGE * spread[1] <= plausible * spread[0]:  # a line, but for the robot's errors
        return
    of_halves = tuple(halves(nominal))
    as_written = [next(each_reading(*half, {(): shots.joints}, points, unit)) for half in of_halves]
    unchanged = as_written[0]
    _check_crossbar(robot, of_halves, as_written, where)
    if unchanged.cost <= plausible:
        if place_mm is not None:
            _check_arms(robot, shots, where, place_mm, unchanged)
        return
    rows = _to_try(len(points))
    joints_by_causes = joint_readings(nominal, shots.joints[rows])
    tried = [
        reading
        for half in of_halves
        for reading in each_reading(*half, joints_by_causes, points[rows], unit)
    ]
    best = min(tried, key=lambda reading: reading.cost)
    right = robot.right_misfit(best.joints)
    is_better = best.cost <= min(unchanged.cost / COVERAGE, robot.plausible_misfit(best.joints))
    if is_better and best.cost <= right:
        raise _refusal_by(_best_readings(tried, right, place_mm), where)
    _check_stations(robot, shots, where)
    is_impossible = unchanged.cost > max(IMPOSSIBLE_MISFIT, plausible)
    if is_impossible:
        _check_maps(robot, shots.rows(rows), where)
    if is_better:
        raise _refusal_by(_best_readings(tried, right, place_mm), where)
    if is_impossible:
        raise ShotsInvalid(
            f"{where}: the points do not follow the joints, and no simple cause explains them: "
            f"after the best fit {100.0 * min(unchanged.cost, 9.99):.0f} % of their spread is "
            f"left, limit {100.0 * max(IMPOSSIBLE_MISFIT, plausible):.0f} %",
            remedy="look at the order of rows, and whether this is the robot of robot.yaml",
        )


def _to_try(count: int) -> Index:
    """Return rows all over the shots, by which causes are tried."""
    return np.unique(np.linspace(0, count - 1, SHOTS_TO_TRY).astype(np.intp))


def _check_stations(robot: _Robot, shots: Shots, where: str, worst_mm: float = math.inf) -> None:
    """Raise `ShotsInvalid` where rigid pieces of the shots fit, but one does not.

    No point may then be farther than `worst_mm` from where the nominal robot puts it.
    """
    modelled = robot.modelled(shots, shots.order_of_time())
    rows, positions, points = modelled.rows, modelled.positions, modelled.points
    if len(rows) < FEWEST_SHOTS:
        return
    limit_mm = robot.plausible_misfit(shots.joints) * spread_mm(positions)
    borders = rigid_pieces(positions, points, limit_mm, worst_mm)[1:]
    if not borders:
        return
    first = [shots.numbers[rows[border]] for border in borders]
    last = shots.numbers[rows[borders[0] - 1]]
    sessions = [f"1 up to shot {last}"]
    for session, (begin, end) in enumerate(zip(first, [*borders[1:], None], strict=True), 2):
        until = f" to {shots.numbers[rows[end - 1]]}" if end else " on"
        sessions.append(f"{session} from shot {begin}{until}")
    raise ShotsInvalid(
        f"{where}: {len(first) + 1} rigid pieces fit the points, one does not: the tracker stood "
        f"elsewhere from shot {' on, and again from shot '.join(map(str, first))} on",
        remedy=f"add a column session, {', '.join(sessions[:-1])} and {sessions[-1]}, and "
        f"identify {OF_SESSIONS}",
    )


def _check_maps(robot: _Robot, shots: Shots, where: str, *, is_possible: bool = False) -> None:
    """Raise `ShotsInvalid` where a scale of lengths or a map of the columns explains shots.

    Of shots that are possible, a factor for each joint would explain the robot's errors too.
    """
    shots = shots.rows(np.flatnonzero(np.isfinite(shots.points_in_tracker_mm).all(axis=1)))
    axes = robot.nominal.mechanism.joints
    modelled = robot.modelled(shots, np.arange(len(shots)))
    if len(shots) < FEWEST_SHOTS:
        return
    if len(modelled.rows) >= FEWEST_SHOTS:
        scale, misfit = similarity_fit(modelled.positions, modelled.points)
        if misfit <= robot.right_misfit(shots.joints):
            raise ShotsInvalid(
                f"{where}: distances between the points are {scale:.3g} times those of the nominal "
                "robot",
                remedy="correct the lengths in robot.yaml, or the unit of the points",
            )
    best = simplest_map(robot.nominal, shots.joints, shots.points_in_tracker_mm, robot.right_misfit)
    if best is None or (is_possible and not best.has_one_factor):
        return
    if causes := best.causes(axes, shots.joints):
        words = " and ".join(word for word, _ in causes)
        raise ShotsInvalid(f"{where}: {words}", remedy=causes[0][1])


# The middle of a crossbar and its halves differ by less than any other causes do: a wrong one may
# stay below the plausible misfit, so it is looked for first.
def _check_crossbar(
    robot: _Robot,
    of_halves: Sequence[tuple[Causes, Kinematics]],
    as_written: Sequence[Reading],
    where: str,
) -> None:
    """Raise `ShotsInvalid` where a half of a crossbar was taken for its middle, or the reverse.

    `as_written` are the readings of the robots in `of_halves`, the first as its file has it.
    """
    best, (_, on_half) = min(
        zip(as_written, of_halves, strict=True), key=lambda reading: reading[0].cost
    )
    limit = min(as_written[0].cost / COVERAGE, robot.plausible_misfit(best.joints))
    models = (robot.nominal, on_half)
    if best.cost <= limit and any(model.mechanism.is_between_halves for model in models):
        raise _refusal_by([best], where)


def _best_readings(
    tried: Sequence[Reading], right_misfit: float, place_mm: Vector3 | None
) -> list[Reading]:
    """Return the readings that fit best with the fewest causes, by the tracker's place if it can.

    Differences up to the misfit of right readings are those of the robot, not of the readings.
    """
    limit = max(right_misfit, min(reading.cost for reading in tried))
    alike = [reading for reading in tried if reading.causes and reading.cost <= limit]
    fewest = min(len(reading.causes) for reading in alike)
    return _nearest_to(place_mm, [reading for reading in alike if len(reading.causes) == fewest])


def _refusal_by(readings: Sequence[Reading], where: str) -> ShotsInvalid:
    """Return the error that names one cause of each kind, with its remedy, and how many more."""
    ambiguous = "correct tracker.place_mm, which decides; then " if len(readings) > 1 else ""
    words, remedies = list[str](), list[str]()
    for of_columns in (False, True):  # many orders of a symmetrical robot fit, and one is enough
        alike = [reading for reading in readings if bool(reading.of_columns) is of_columns]
        if alike:
            fit = "fits" if len(alike) == 2 else "fit"
            more = f" that {fit} as well" if alike[1:] else ""
            words.append(f"{listed([reading.words for reading in alike], 1)}{more}")
            remedies.append(alike[0].remedy)
    return ShotsInvalid(
        f"{where}: {', or '.join(words)}", remedy=f"{ambiguous}{', or '.join(remedies)}"
    )


def _nearest_to(place_mm: Vector3 | None, readings: list[Reading]) -> list[Reading]:
    """Return the one reading with the tracker near the stated place; all if none is, or several.

    The most likely come first: a mirrored frame, and the half of the plate before columns.
    """
    readings = sorted(
        readings, key=lambda r: (MIRRORED not in r.causes, bool(r.of_columns), r.cost)
    )
    if place_mm is None:
        return readings
    off_mm = [math.dist(reading.tracker_mm, place_mm) for reading in readings]
    limit_mm = COVERAGE * min(off_mm)
    near = [r for r, mm in zip(readings, off_mm, strict=True) if mm <= limit_mm]
    return near if len(near) == 1 else readings


def _check_arms(
    robot: _Robot, shots: Shots, where: str, place_mm: Vector3, unchanged: Reading
) -> None:
    """Raise `ShotsInvalid` where the tracker's place shows that the arms are named from another.

    A symmetrical robot fits also with every arm's joint given to the next arm; the tracker then
    seems to stand elsewhere.
    """
    # Where the tracker is not about where it should be, try every turn of the arms' names about the
    # robot's axis: one is accused if its points fit and bring the tracker to its place.
    found_mm, axes = unchanged.tracker_mm, robot.nominal.mechanism.joints
    arms = len(axes)
    off_mm = math.dist(found_mm, place_mm)
    if not off_mm >= ROUGH_PLACE_MM:  # NaN, of points on a line, shows nothing either
        return
    # A platform of two parts comes back to itself after half a turn only.
    turns = (arms // 2,) if robot.nominal.mechanism.halves else range(1, arms)
    for step, (on_half, seen) in product(turns, halves(robot.nominal)):
        order = tuple((arm - step) % arms for arm in range(arms))
        turned = JointMap(order, np.ones(arms), np.zeros(arms))
        meant = {turned.causes(axes, shots.joints): turned.joints(shots.joints)}
        moved = next(each_reading(on_half, seen, meant, shots.points_in_tracker_mm, "mm"))
        plausible = robot.plausible_misfit(moved.joints)
        moved_off_mm = math.dist(moved.tracker_mm, place_mm)
        if moved.cost <= plausible and moved_off_mm < ROUGH_PLACE_MM:
            x, y, z = found_mm.tolist()
            raise ShotsInvalid(
                f"{where}: the tracker is found at ({x:.0f}, {y:.0f}, {z:.0f}) mm, "
                f"{off_mm / MM_PER_UNIT['m']:.1f} m from tracker.place_mm and turned from it by "
                f"{360 * step // arms}° about the robot's axis",
                remedy=f"correct tracker.place_mm; if that is right, {moved.words}: {moved.remedy}",
            )
