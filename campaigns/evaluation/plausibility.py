"""Plausibility of measured shots and of identified parameters, judged by the nominal robot.

A fit cannot distinguish points in metres from a robot a thousand times smaller, and hold-out pairs
agree, being in the same unit. Only the nominal robot contradicts it: its positions at the recorded
joints must be the measured points up to a rigid motion, nearly so even before any fit.

If they are not, the shots are tried in every way in which people get such files wrong: joints in
radians, of the other sign or in another order; the reflector on the other half of the plate; the
frame mirrored; lengths in another unit. Each reading has a cost, the misfit that is left after the
best similarity (rigid motion and scale), in parts of the points' spread. A reading that fits far
better than what is written names the cause, with a remedy. Where the robot's symmetry lets several
readings fit alike, the tracker's rough place decides, or they are all named.

A few gross errors among the shots must not decide: every fit is of the four fifths that agree best.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations, permutations, product

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.errors import ShotsInvalid
from campaigns.fit.rigid_transforms import best_rotation, fit_transform
from campaigns.kinematics.model import Kinematics
from campaigns.kinematics.parameters import ParameterTable
from campaigns.robots.schema import Tolerance
from campaigns.shots.point_words import MM_PER_UNIT, LengthUnit
from campaigns.shots.shots import Shots
from drivers.values import DISTANCE, JOINT_ANGLE, PART_TEMPERATURE, SIGMA, TEMPERATURE, Vector3

UNITS: Mapping[LengthUnit, str] = {
    "mm": "millimetres",
    "m": "metres",
    "cm": "centimetres",
    "inch": "inches",
    "ft": "feet",
    "um": "micrometres",
}
MIRRORED = ("the frame of the points is mirrored", "turn the sign of one coordinate, such as z")
COLUMNS = "correct the columns of the joints"

FEWEST_SHOTS = 5
"""Shots below which a frame explains nearly everything."""
SHOTS_TO_TRY = 24
"""Shots by which other readings are tried: hundreds of readings of all shots would take long."""
JUDGED_SHARE = 0.8
"""Share of the shots by which a fit is judged, so that a few gross errors do not decide."""
TRIMMING_ROUNDS = 5
LINE_SPREAD = 0.02
"""Points whose second spread is below this part of the first lie on a line: no frame."""
PLAUSIBLE_MISFIT = 0.06
"""Misfit in parts of the points' spread: robots with lengths off by 10 mm and joints by 5° stay
below it, and one of the wrong order of joints is above."""
BETTER_BY = 0.6
"""Ratio of misfits below which another reading is the cause."""
AS_GOOD_WITHIN = 1.2
"""Readings this near to the best are named too, unless the tracker's place excludes them."""
IMPOSSIBLE_MISFIT = 0.3
"""Misfit that no robot of this kind has, whatever the cause."""
MOST_IN_ANY_ORDER = 4
"""Joints up to which every order is tried."""
NEARER_BY = 0.3
"""Ratio of distances from the stated place below which the nearer of two places is right."""
ROUGH_PLACE_MM = 1000.0
"""Error of a rough place of the tracker: below it the place is not contradicted."""

Causes = tuple[tuple[str, str], ...]
"""What is different from how it is written: causes in words, each with its remedy."""


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """Way in which joints and points may have been meant."""

    causes: Causes
    cost: float
    """Misfit, with the logarithm of the scale that no unit explains and the share of lost shots."""
    positions_mm: Array
    """Modelled positions at the joints so read, (M, 3), in the base frame."""
    points_mm: Array
    """Measured points so read, (M, 3), in the tracker's frame."""

    @property
    def words(self) -> str:
        """The causes."""
        return " and ".join(cause for cause, _ in self.causes)

    @property
    def remedy(self) -> str:
        """Remedy for each cause."""
        return "; ".join(remedy for _, remedy in self.causes)

    @property
    def tracker_mm(self) -> Array:
        """The tracker's place (3,) in the base frame; NaN if the points lie on a line."""
        with suppress(ValueError):
            rows = _greater_part(self.positions_mm, self.points_mm, scaled=False)
            fitted = fit_transform(self.positions_mm[rows], self.points_mm[rows])
            return fitted.inverted().translation_mm
        return np.full(3, np.nan)


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
) -> None:
    """Raise `ShotsInvalid`, naming the cause, for shots that cannot be this robot's.

    `where` names the file or series. `place_mm` is the tracker's rough place in the base frame: it
    alone distinguishes arms where the robot is symmetrical about its axis. `unit`: of the file as
    it was read.
    """
    _check_joints(nominal, shots, where)
    _check_reading(nominal, shots, where, place_mm, unit)
    _check_values(shots, where)


def check_distances(nominal: Kinematics, shots: Shots, limit_mm: float, where: str) -> None:
    """Raise `ShotsInvalid` for a point farther than a gate from where the nominal robot puts it.

    A run has this gate for every shot; imported shots get it here, after the best rigid fit of the
    greater part of them.
    """
    modelled = nominal.forward(shots.joints)
    rows = np.flatnonzero(modelled.is_solved & np.isfinite(shots.points_in_tracker_mm).all(axis=1))
    if len(rows) < FEWEST_SHOTS:
        return
    positions, points = nominal.points(modelled.values[rows]), shots.points_in_tracker_mm[rows]
    part = _greater_part(positions, points, scaled=False)
    _, residuals = _similarity(positions, points, part, scaled=False)
    off_mm = np.linalg.norm(residuals, axis=1)
    worst = int(np.argmax(off_mm))
    if off_mm[worst] > limit_mm:
        raise ShotsInvalid(
            f"{where}: shot {shots.numbers[rows[worst]]}: its point is {off_mm[worst]:.0f} mm from "
            f"where the nominal robot puts it, limit {limit_mm:g} mm",
            remedy="a wrong target or wrong joints: correct the row or leave it out; a robot that "
            "is so far off needs a larger gate.distance_mm",
        )


def _check_joints(nominal: Kinematics, shots: Shots, where: str) -> None:
    """Raise `ShotsInvalid` for angles that no encoder in degrees has."""
    for place, axis in enumerate(nominal.mechanism.joints):
        beyond = np.abs(shots.joints[:, place]) > math.radians(JOINT_ANGLE.most)
        if axis.is_revolute and beyond.any():
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
    nominal: Kinematics, shots: Shots, where: str, place_mm: Vector3 | None, unit: LengthUnit
) -> None:
    """Raise `ShotsInvalid` where another reading fits far better, or what is written not at all."""
    # 1. Compare the places of the reflector, with all else as it is written.
    # 2. If what is written fits, only the tracker's place can contradict it.
    # 3. Otherwise try every reading, on some of the shots, and name those that fit far better.
    # 4. In between the shots pass: a robot that is far off its drawing is what the fit is for.
    points = shots.points_in_tracker_mm
    if len(points) < FEWEST_SHOTS or _is_line(points):
        return
    halves = tuple(_halves(nominal))
    as_written = [next(_readings(*half, {(): shots.joints}, points, unit)) for half in halves]
    unchanged = as_written[0]
    _check_crossbar(halves, as_written, where)
    if unchanged.cost <= PLAUSIBLE_MISFIT:
        if place_mm is not None:
            _check_arms(nominal, shots, where, place_mm, unchanged)
        return
    rows = np.unique(np.linspace(0, len(points) - 1, SHOTS_TO_TRY).astype(int))
    joints_by_causes = _joint_readings(nominal, shots.joints[rows])
    tried = [
        reading
        for half in halves
        for reading in _readings(*half, joints_by_causes, points[rows], unit)
    ]
    best_cost = min(reading.cost for reading in tried)
    if best_cost <= BETTER_BY * unchanged.cost and best_cost <= IMPOSSIBLE_MISFIT:
        raise _refusal_by(_best_readings(tried, place_mm), where)
    if unchanged.cost > IMPOSSIBLE_MISFIT:
        raise ShotsInvalid(
            f"{where}: the points do not follow the joints: after the best fit "
            f"{100.0 * min(unchanged.cost, 9.99):.0f} % of their spread is left, limit "
            f"{100.0 * IMPOSSIBLE_MISFIT:.0f} %",
            remedy="look at the order of rows, the order and signs of joints, and whether "
            "this is the robot of robot.yaml",
        )


# The middle of a crossbar and its halves differ by less than any other causes do: a wrong one may
# stay below the plausible misfit, so it is looked for first.
def _check_crossbar(
    halves: Sequence[tuple[Causes, Kinematics]], as_written: Sequence[Reading], where: str
) -> None:
    """Raise `ShotsInvalid` where a half of a crossbar was taken for its middle, or the reverse.

    `as_written` are the readings of the robots in `halves`, the first as its file has it.
    """
    (_, nominal), unchanged = halves[0], as_written[0]
    costs = [reading.cost for reading in as_written]
    place = costs.index(min(costs))
    _, robot = halves[place]
    is_middle = [model.mechanism.is_between_halves for model in (nominal, robot)]
    best = as_written[place]
    if best.cost <= min(BETTER_BY * unchanged.cost, PLAUSIBLE_MISFIT) and any(is_middle):
        raise _refusal_by([best], where)


def _best_readings(tried: Sequence[Reading], place_mm: Vector3 | None) -> list[Reading]:
    """Return the readings that fit best with the fewest causes, by the tracker's place if it can.

    Below half a plausible misfit differences are those of the robot, not of the readings.
    """
    best_cost = min(reading.cost for reading in tried)
    limit = AS_GOOD_WITHIN * max(best_cost, 0.5 * PLAUSIBLE_MISFIT)
    alike = [reading for reading in tried if reading.causes and reading.cost <= limit]
    fewest = min(len(reading.causes) for reading in alike)
    return _nearest_to(place_mm, [reading for reading in alike if len(reading.causes) == fewest])


def _refusal_by(readings: Sequence[Reading], where: str) -> ShotsInvalid:
    """Return the error that names all causes that these readings suggest, with their remedies."""
    words = dict.fromkeys(reading.words for reading in readings)
    remedies = dict.fromkeys(reading.remedy for reading in readings)
    ambiguous = "correct tracker.place_mm, which decides; then " if len(remedies) > 1 else ""
    return ShotsInvalid(
        f"{where}: {', or '.join(words)}", remedy=f"{ambiguous}{', or '.join(remedies)}"
    )


def _nearest_to(place_mm: Vector3 | None, readings: list[Reading]) -> list[Reading]:
    """Return the one reading with the tracker near the stated place; all if none is, or several.

    The most likely come first: a mirrored frame, and the half of the plate before columns.
    """
    readings = sorted(readings, key=lambda r: (MIRRORED not in r.causes, r.remedy == COLUMNS))
    if place_mm is None:
        return readings
    off_mm = [math.dist(reading.tracker_mm, place_mm) for reading in readings]
    nearest = min(off_mm)
    near = [r for r, mm in zip(readings, off_mm, strict=True) if nearest >= NEARER_BY * mm]
    return near if len(near) == 1 else readings


def _is_line(points: Array) -> bool:
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] <= LINE_SPREAD * spread[0])


def _halves(nominal: Kinematics) -> Iterator[tuple[Causes, Kinematics]]:
    """Yield the robot as its file says, then with the reflector on other parts of the plate."""
    yield (), nominal
    for half in nominal.mechanism.halves:
        seen = nominal.mechanism.seen_from(half)
        cause = "the reflector seems to be in the middle of the crossbar"
        remedy = "delete reflector_half in robot.yaml"
        if half is not None:
            cause = f"the reflector seems to be on half {half} of the plate"
            remedy = f"say reflector_half: {half} in robot.yaml"
        yield ((cause, remedy),), replace(nominal, mechanism=seen)


def _joint_readings(nominal: Kinematics, joints: Array) -> dict[Causes, Array]:
    """Return joints (N, n) as they may be meant: in radians, of other signs, in another order."""
    # All signs in the written order, and all orders with all signs alike. Every sign in every
    # order would multiply the readings: 384 instead of 64 for four joints.
    # Joints given in radians were read as degrees and are too small by 180/π: np.degrees undoes it.
    axes = nominal.mechanism.joints
    meant: dict[Causes, Array] = {(): joints}
    turns = np.array([axis.is_revolute for axis in axes])
    if turns.any():
        cause = ("the joints look like radians", "give the joints in degrees")
        meant[cause,] = np.where(turns, np.degrees(joints), joints)
    as_written, signs = tuple(range(len(axes))), [*product((1.0, -1.0), repeat=len(axes))]
    uniform_signs = (signs[0], signs[-1])
    kinds = [axis.kind for axis in axes]
    # a column's name has its unit, so that no one takes one kind of joint for the other
    orders = [
        (order, sign)
        for order in _orders(len(axes))
        for sign in uniform_signs
        if [kinds[place] for place in order] == kinds
    ]
    for order, sign in (*((as_written, sign) for sign in signs), *orders):
        if words := " and ".join(_joint_words(order, sign)):
            meant[(words, COLUMNS),] = joints[:, order] * np.array(sign)
    return meant


# Six joints have 720 orders, which take half a minute to try. People swap two columns, or number
# the joints from another one on or the other way around: 26 orders.
def _orders(count: int) -> Iterator[tuple[int, ...]]:
    """Yield the orders in which joints may stand: all of them of up to four joints."""
    as_written = tuple(range(count))
    if count <= MOST_IN_ANY_ORDER:
        yield from permutations(as_written)
        return
    for first, second in combinations(as_written, 2):
        swapped = [*as_written]
        swapped[first], swapped[second] = second, first
        yield tuple(swapped)
    for way in (as_written, as_written[::-1]):
        yield from (way[begin:] + way[:begin] for begin in as_written)


def _check_arms(
    nominal: Kinematics, shots: Shots, where: str, place_mm: Vector3, unchanged: Reading
) -> None:
    """Raise `ShotsInvalid` where the tracker's place shows that the arms are named from another.

    A symmetrical robot fits also with every arm's joint given to the next arm; the tracker then
    seems to stand elsewhere.
    """
    # Where the tracker is not about where it should be, try every turn of the arms' names about the
    # robot's axis: one is accused if its points fit and bring the tracker to its place.
    found_mm, arms = unchanged.tracker_mm, len(nominal.mechanism.joints)
    off_mm = math.dist(found_mm, place_mm)
    if not off_mm >= ROUGH_PLACE_MM:  # NaN, of points on a line, shows nothing either
        return
    # A platform of two parts comes back to itself after half a turn only.
    turns = (arms // 2,) if nominal.mechanism.halves else range(1, arms)
    for step, (on_half, robot) in product(turns, _halves(nominal)):
        order = tuple((arm - step) % arms for arm in range(arms))
        words = " and ".join(_joint_words(order, (1.0,) * arms))
        meant: dict[Causes, Array] = {((words, COLUMNS),): shots.joints[:, order]}
        moved = next(_readings(on_half, robot, meant, shots.points_in_tracker_mm, "mm"))
        moved_off_mm = math.dist(moved.tracker_mm, place_mm)
        if moved.cost <= PLAUSIBLE_MISFIT and moved_off_mm <= NEARER_BY * off_mm:
            x, y, z = found_mm.tolist()
            raise ShotsInvalid(
                f"{where}: the tracker is found at ({x:.0f}, {y:.0f}, {z:.0f}) mm, "
                f"{off_mm / MM_PER_UNIT['m']:.1f} m from tracker.place_mm and turned from it by "
                f"{360 * step // arms}° about the robot's axis",
                remedy=f"correct tracker.place_mm; if that is right, {moved.words}: {moved.remedy}",
            )


def _joint_words(order: tuple[int, ...], sign: tuple[float, ...]) -> Iterator[str]:
    if order != tuple(range(len(order))):
        yield f"the joints seem to stand in the order {', '.join(f'q{q}' for q in order)}"
    if max(sign) < 0.0:
        yield "all joints seem to have the other sign"
    elif min(sign) < 0.0:
        wrong = ", ".join(f"q{place}" for place, factor in enumerate(sign) if factor < 0.0)
        yield f"the sign of {wrong} seems to be turned"


def _readings(
    on_half: Causes,
    robot: Kinematics,
    meant: Mapping[Causes, Array],
    points: Array,
    unit: LengthUnit,
) -> Iterator[Reading]:
    """Yield each way to read the file: joints (N, n) by causes, with each unit, mirrored and not.

    The first reading takes the points as they are written.
    """
    # 1. Solve the forward model for all readings of the joints in one stack: that is most of the
    #    time.
    # 2. Shots that the robot cannot take by a reading add up to 0.5 to its cost. A reading with
    #    fewer than five shots left is no candidate.
    # 3. Read the points as they are and mirrored, each in the written unit and in the likeliest.
    solution = robot.forward(np.concatenate([*meant.values()]))
    positions_by_causes = np.split(robot.points(solution.values), len(meant))
    is_solved_by_causes = np.split(solution.is_solved, len(meant))
    for of_joints, positions, is_solved in zip(
        meant, positions_by_causes, is_solved_by_causes, strict=True
    ):
        causes, reached, seen = (*on_half, *of_joints), positions[is_solved], points[is_solved]
        if len(seen) < FEWEST_SHOTS:
            yield Reading(causes, math.inf, reached, seen)
            continue
        cost_of_lost = 0.5 * (1.0 - len(seen) / len(points))
        mirrored = seen * np.array([1.0, 1.0, -1.0])
        for of_frame, measured in (((), seen), ((MIRRORED,), mirrored)):
            for reading in _readings_by_unit(reached, measured, unit):
                yield replace(
                    reading,
                    causes=(*causes, *of_frame, *reading.causes),
                    cost=reading.cost + cost_of_lost,
                )


# A scale is explained by the nearest unit, at the price of one more cause; the logarithm of what no
# unit explains adds to the misfit. Factors 2 and ½: lengths doubled or halved.
def _readings_by_unit(positions: Array, points: Array, unit: LengthUnit) -> Iterator[Reading]:
    """Yield the reading of points (M, 3) in their unit, and that in the unit nearest to the fit."""
    factors = [MM_PER_UNIT[unit] / MM_PER_UNIT[right] for right in UNITS] + [2.0, 0.5]
    scale, misfit = _similarity_fit(positions, points)
    nearest = min(factors, key=lambda factor: abs(math.log(scale / factor)))
    for factor in dict.fromkeys((1.0, nearest)):
        causes = () if factor == 1.0 else (_unit_cause(factor, unit),)
        cost = math.hypot(misfit, math.log(scale / factor))
        yield Reading(causes, cost, positions, points / factor)


def _unit_cause(factor: float, unit: LengthUnit) -> tuple[str, str]:
    """Return cause and remedy of points that are too large by a factor, read in a unit."""
    for right, words in UNITS.items():
        if MM_PER_UNIT[unit] / MM_PER_UNIT[right] == factor:
            return f"the points look like {words}, not {unit}", f"import with --unit {right}"
    cause = f"distances between the points are {factor:g} times those of the nominal robot"
    return cause, "give lengths as measured, neither doubled nor halved"


def _similarity_fit(modelled: Array, measured: Array) -> tuple[float, float]:
    """Return the scale of the best similarity with the greater part of the points, and its misfit.

    The misfit is the root mean square residual in parts of the points' spread.
    """
    rows = _greater_part(modelled, measured, scaled=True)
    scale, residuals = _similarity(modelled, measured, rows, scaled=True)
    size = float(np.linalg.norm(measured[rows] - measured[rows].mean(axis=0)))
    return scale, float(np.linalg.norm(residuals[rows])) / size if size > 0.0 else math.inf


def _greater_part(modelled: Array, measured: Array, *, scaled: bool) -> Index:
    """Return the rows that fit best together, without the worst ones (trimmed least squares)."""
    # Fit, keep the rows with the smallest residuals, fit again to these: each round can only lower
    # the trimmed sum of squares. Rows that were left out may come back.
    rows = np.arange(len(modelled))
    keep = max(FEWEST_SHOTS - 1, int(JUDGED_SHARE * len(modelled)))
    for _ in range(TRIMMING_ROUNDS):
        _, residuals = _similarity(modelled, measured, rows, scaled=scaled)
        rows = np.sort(np.argsort(np.linalg.norm(residuals, axis=1), kind="stable")[:keep])
    return rows


def _similarity(
    modelled: Array, measured: Array, rows: Index, *, scaled: bool
) -> tuple[float, Array]:
    """Return the scale of the best similarity of some rows (Umeyama 1991), and all residuals."""
    a, b = (points - points[rows].mean(axis=0) for points in (modelled, measured))
    rotation, spread = best_rotation(a[rows], b[rows])
    size = float(np.sum(a[rows] ** 2))
    scale = float(np.sum(spread)) / size if scaled and size > 0.0 else 1.0
    scale = max(scale, np.finfo(np.float64).tiny)  # its logarithm is taken
    return scale, np.asarray(b - scale * a @ rotation.T)
