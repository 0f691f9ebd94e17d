"""Plausibility of measured shots and of identified parameters, judged by the nominal robot.

A fit cannot distinguish points in metres from a robot a thousand times smaller, and hold-out pairs
agree, being in the same unit. Only the nominal robot contradicts it: its positions at the recorded
joints must be the measured points up to a rigid motion, nearly so even before any fit.

If they are not, causes are fitted, the simplest first, and one is named only if no more remains
then than with shots that were read rightly:

1. another reading: unit, mirrored frame, half of the plate, radians, signs or order of the joints
   (`readings`). Where the robot's symmetry lets several fit alike, the tracker's rough place
   decides, or they are all named;
2. a tracker that stood elsewhere from some shot on: two rigid pieces fit, one does not;
3. another scale of lengths, and an affine map for each joint: factor and zero (`joint_maps`).

Zeros, factors and scales that are less than wrong are for the fit itself to find.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import product

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.errors import ShotsInvalid
from campaigns.evaluation.joint_maps import map_in_words, simplest_map
from campaigns.evaluation.readings import (
    COLUMNS,
    FEWEST_SHOTS,
    MIRRORED,
    Causes,
    Reading,
    each_reading,
    greater_part,
    halves,
    joint_readings,
    joint_words,
    similarity,
    similarity_fit,
)
from campaigns.kinematics.model import Kinematics
from campaigns.kinematics.parameters import ParameterTable
from campaigns.robots.schema import Tolerance
from campaigns.shots.point_words import MM_PER_UNIT, LengthUnit
from campaigns.shots.shots import Shots
from drivers.values import DISTANCE, JOINT_ANGLE, PART_TEMPERATURE, SIGMA, TEMPERATURE, Vector3

SHOTS_TO_TRY = 24
"""Shots by which other readings are tried: hundreds of readings of all shots would take long."""
LINE_SPREAD = 0.02
"""Points whose second spread is below this part of the first lie on a line: no frame."""
PLAUSIBLE_MISFIT = 0.06
"""Misfit in parts of the points' spread: robots with lengths off by 10 mm and joints by 5° stay
below it, and one of the wrong order of joints is above."""
BETTER_BY = 0.6
"""Ratio of misfits below which another reading is the cause."""
RIGHT_MISFIT = BETTER_BY * PLAUSIBLE_MISFIT
"""Misfit of shots that are read rightly, up to which a cause explains them without doubt."""
IMPOSSIBLE_MISFIT = 0.3
"""Misfit that no robot of this kind has: below it the robot may be far off its drawing."""
NEARER_BY = 0.3
"""Ratio of distances from the stated place below which the nearer of two places is right."""
ROUGH_PLACE_MM = 1000.0
"""Error of a rough place of the tracker: below it the place is not contradicted."""


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
    part = greater_part(positions, points, scaled=False)
    _, residuals = similarity(positions, points, part, scaled=False)
    off_mm = np.linalg.norm(residuals, axis=1)
    worst = int(np.argmax(off_mm))
    if off_mm[worst] > limit_mm:
        # what holds for many shots is no error of this one
        _check_stations(nominal, shots, where, limit_mm)
        spread = np.linalg.norm(points[part] - points[part].mean(axis=0))
        if np.linalg.norm(residuals[part]) > PLAUSIBLE_MISFIT * spread:
            _check_maps(nominal, shots.rows(_to_try(len(shots))), where)
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
    # 3. Otherwise fit causes to some of the shots, and name the simplest that explain them.
    # 4. In between the shots pass: a robot that is far off its drawing is what the fit is for.
    points = shots.points_in_tracker_mm
    if len(points) < FEWEST_SHOTS or _is_line(points):
        return
    of_halves = tuple(halves(nominal))
    as_written = [next(each_reading(*half, {(): shots.joints}, points, unit)) for half in of_halves]
    unchanged = as_written[0]
    _check_crossbar(of_halves, as_written, where)
    if unchanged.cost <= PLAUSIBLE_MISFIT:
        if place_mm is not None:
            _check_arms(nominal, shots, where, place_mm, unchanged)
        return
    rows = _to_try(len(points))
    joints_by_causes = joint_readings(nominal, shots.joints[rows])
    tried = [
        reading
        for half in of_halves
        for reading in each_reading(*half, joints_by_causes, points[rows], unit)
    ]
    best_cost = min(reading.cost for reading in tried)
    is_better = best_cost <= min(BETTER_BY * unchanged.cost, PLAUSIBLE_MISFIT)
    if is_better and best_cost <= RIGHT_MISFIT:
        raise _refusal_by(_best_readings(tried, place_mm), where)
    _check_stations(nominal, shots, where)
    if unchanged.cost > IMPOSSIBLE_MISFIT:
        _check_maps(nominal, shots.rows(rows), where)
    if is_better:
        raise _refusal_by(_best_readings(tried, place_mm), where)
    if unchanged.cost > IMPOSSIBLE_MISFIT:
        raise ShotsInvalid(
            f"{where}: the points do not follow the joints, and no simple cause explains them: "
            f"after the best fit {100.0 * min(unchanged.cost, 9.99):.0f} % of their spread is "
            f"left, limit {100.0 * IMPOSSIBLE_MISFIT:.0f} %",
            remedy="look at the order of rows, and whether this is the robot of robot.yaml",
        )


def _to_try(count: int) -> Index:
    """Return rows all over the shots, by which causes are tried."""
    return np.unique(np.linspace(0, count - 1, SHOTS_TO_TRY).astype(np.intp))


def _check_stations(
    nominal: Kinematics, shots: Shots, where: str, limit_mm: float = math.inf
) -> None:
    """Raise `ShotsInvalid` where two rigid pieces of the shots fit, but one does not.

    No point may then be farther than `limit_mm` from where the nominal robot puts it.
    """
    # Every border between the pieces is tried, in the order of time, for the sum of their squares.
    order = shots.order_of_time()
    modelled = nominal.forward(shots.joints[order])
    points = shots.points_in_tracker_mm[order]
    is_usable = modelled.is_solved & np.isfinite(points).all(axis=1)
    rows, points = order[is_usable], points[is_usable]
    positions = nominal.points(modelled.values[is_usable])
    best = (math.inf, 0)
    for border in range(FEWEST_SHOTS, len(rows) - FEWEST_SHOTS + 1):
        pieces = np.split(np.arange(len(rows)), [border])
        off = np.concatenate(
            [
                similarity(positions[piece], points[piece], np.arange(len(piece)), scaled=False)[1]
                for piece in pieces
            ]
        )
        apart = np.concatenate([points[piece] - points[piece].mean(axis=0) for piece in pieces])
        if np.linalg.norm(off, axis=1).max() <= limit_mm:
            best = min(best, (float(np.linalg.norm(off) / np.linalg.norm(apart)), border))
    misfit, border = best
    if misfit > RIGHT_MISFIT:
        return
    last, first = (shots.numbers[rows[row]] for row in (border - 1, border))
    raise ShotsInvalid(
        f"{where}: two rigid pieces fit the points, one does not: the tracker stood elsewhere from "
        f"shot {first} on",
        remedy=f"add a column session, 1 up to shot {last} and 2 from shot {first} on, and "
        "identify --sessions",
    )


def _check_maps(nominal: Kinematics, shots: Shots, where: str) -> None:
    """Raise `ShotsInvalid` where a scale of lengths or affine maps of the joints explain shots."""
    shots = shots.rows(np.flatnonzero(np.isfinite(shots.points_in_tracker_mm).all(axis=1)))
    points = shots.points_in_tracker_mm
    modelled = nominal.forward(shots.joints)
    if np.count_nonzero(modelled.is_solved) >= FEWEST_SHOTS:
        solved = modelled.is_solved
        scale, misfit = similarity_fit(nominal.points(modelled.values[solved]), points[solved])
        if misfit <= RIGHT_MISFIT:
            raise ShotsInvalid(
                f"{where}: distances between the points are {scale:.3g} times those of the nominal "
                "robot",
                remedy="correct the lengths in robot.yaml, or the unit of the points",
            )
    best = simplest_map(nominal, shots.joints, points, RIGHT_MISFIT)
    if best is not None:
        cause, remedy = map_in_words(best, nominal.mechanism.joints)
        raise ShotsInvalid(f"{where}: {cause}", remedy=remedy)


# The middle of a crossbar and its halves differ by less than any other causes do: a wrong one may
# stay below the plausible misfit, so it is looked for first.
def _check_crossbar(
    of_halves: Sequence[tuple[Causes, Kinematics]], as_written: Sequence[Reading], where: str
) -> None:
    """Raise `ShotsInvalid` where a half of a crossbar was taken for its middle, or the reverse.

    `as_written` are the readings of the robots in `of_halves`, the first as its file has it.
    """
    (_, nominal), unchanged = of_halves[0], as_written[0]
    costs = [reading.cost for reading in as_written]
    place = costs.index(min(costs))
    _, robot = of_halves[place]
    is_middle = [model.mechanism.is_between_halves for model in (nominal, robot)]
    best = as_written[place]
    if best.cost <= min(BETTER_BY * unchanged.cost, PLAUSIBLE_MISFIT) and any(is_middle):
        raise _refusal_by([best], where)


def _best_readings(tried: Sequence[Reading], place_mm: Vector3 | None) -> list[Reading]:
    """Return the readings that fit best with the fewest causes, by the tracker's place if it can.

    Differences up to the misfit of right readings are those of the robot, not of the readings.
    """
    limit = max(RIGHT_MISFIT, min(reading.cost for reading in tried))
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
    for step, (on_half, robot) in product(turns, halves(nominal)):
        order = tuple((arm - step) % arms for arm in range(arms))
        words = " and ".join(joint_words(order, (1.0,) * arms))
        meant: dict[Causes, Array] = {((words, COLUMNS),): shots.joints[:, order]}
        moved = next(each_reading(on_half, robot, meant, shots.points_in_tracker_mm, "mm"))
        moved_off_mm = math.dist(moved.tracker_mm, place_mm)
        if moved.cost <= PLAUSIBLE_MISFIT and moved_off_mm <= NEARER_BY * off_mm:
            x, y, z = found_mm.tolist()
            raise ShotsInvalid(
                f"{where}: the tracker is found at ({x:.0f}, {y:.0f}, {z:.0f}) mm, "
                f"{off_mm / MM_PER_UNIT['m']:.1f} m from tracker.place_mm and turned from it by "
                f"{360 * step // arms}° about the robot's axis",
                remedy=f"correct tracker.place_mm; if that is right, {moved.words}: {moved.remedy}",
            )
