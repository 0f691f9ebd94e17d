"""Plausibility of measured shots and of found parameters, by what is known of the nominal robot.

A fit cannot tell points in metres from a robot a thousand times smaller, and pairs that it never
saw agree, being in the same unit. Only the nominal robot speaks against it: its positions at the
joints read must be the measured points up to a rigid motion, and nearly so before any fit.
"""

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.errors import ShotsInvalid
from campaigns.fit.rigid_transforms import best_rotation, fit_transform
from campaigns.kinematics.mechanism import Kinematics, KinematicSolution
from campaigns.kinematics.parameters import ParameterTable
from campaigns.robots.schema import Tolerance
from campaigns.shots.point_header import MM_PER_UNIT, LengthUnit
from campaigns.shots.shots import Shots
from drivers.values import DISTANCE, JOINT_ANGLE, PART_TEMPERATURE, SIGMA, TEMPERATURE, Vector3

UNITS: Mapping[LengthUnit, str] = {
    "m": "metres",
    "cm": "centimetres",
    "inch": "inches",
    "ft": "feet",
    "um": "micrometres",
}
"""Units that points may be in by mistake, by the word of --unit."""
FACTORS = (*(1.0 / MM_PER_UNIT[unit] for unit in UNITS), 2.0, 0.5)
MIRRORED = "the frame of the points is mirrored"

FEWEST = 5
"""Shots below which a frame explains nearly everything."""
SAMPLE = 24
"""Shots by which other readings of the joints are tried."""
KEPT = 0.8
"""Share of the shots by which a fit is judged, so that a few gross errors say nothing."""
TRIMMINGS = 5
THIN = 0.02
"""Points whose second spread is below this part of the first lie on a line and tell nothing."""
NEAR = 0.06
"""Misfit in parts of the points' spread: robots with lengths off by 10 mm and joints by 5° stay
below it, and one of the wrong order of joints is above."""
BETTER = 0.6
"""Another reading must fit so much better to be the cause."""
AS_GOOD = 1.2
"""Readings this near to the best are named too: symmetry tells no difference between them."""
IMPOSSIBLE = 0.3
"""Misfit that no robot of this kind has, whatever the cause."""
OF_ONE_PART = 3
"""Arms of a platform of one part, which may be named from any of them."""
SWAPPED = (2, 3, 0, 1)
"""Order of the joints with the arms of the platform's two parts swapped."""
COLUMNS = "correct the columns of the joints"
IN_THE_MIDDLE = (
    "the reflector seems to be in the middle of the crossbar",
    "delete reflector_half in robot.yaml",
)
NEARER = 0.3
"""Ratio of distances from the stated place below which the nearer of two places is right."""
FAR_MM = 1000.0
"""Distance from a rough place, below which that is right."""
PLACES = ("x_mm", "y_mm", "z_mm")


@dataclass(frozen=True, slots=True)
class Reading:
    """Way in which joints and points may have been meant."""

    words: str
    """Cause in words; empty for as they are written."""
    remedy: str
    cost: float
    """Misfit and what no unit explains of the scale."""
    steps: int
    """Number of things that are different from what is written."""


def beyond_tolerance(
    space: ParameterTable, tolerance: Tolerance, changes: Mapping[str, float]
) -> Iterator[str]:
    """Return changes (mm and deg, by name) beyond the tolerance, the largest first, in words."""
    limits = {name: tolerance.of(space[name]) for name in changes}
    beyond = {name: change for name, change in changes.items() if not abs(change) <= limits[name]}
    for name in sorted(beyond, key=lambda each: -abs(beyond[each]) / limits[each]):
        sign = space[name].sign
        yield f"{name} changed by {beyond[name]:+.4g}{sign}, tolerance ± {limits[name]:g}{sign}"


def check_shots(
    nominal: Kinematics,
    shots: Shots,
    where: str,
    place_mm: Vector3 | None = None,
    modelled: KinematicSolution | None = None,
) -> None:
    """Raise `ShotsInvalid`, naming the cause, for shots that cannot be this robot's in mm and rad.

    `where` names the file or series. `place_mm` is the tracker's rough place in the base frame: it
    alone tells arms apart where the robot is symmetrical about its axis. `modelled`: the nominal
    robot's poses at the shots, where somebody knows them.
    """
    _check_joints(nominal, shots, where)
    _check_reading(nominal, shots, where, place_mm, modelled)
    _check_values(shots, where)


def check_unit(nominal: Kinematics, shots: Shots, where: str, unit: LengthUnit) -> None:
    """Raise `ShotsInvalid`, naming the right unit, for points that were read in a wrong one."""
    points = shots.points_in_tracker_mm
    modelled = nominal.forward(shots.joints)
    rows = np.flatnonzero(modelled.found & np.isfinite(points).all(axis=1))
    if len(rows) < FEWEST or _on_a_line(points[rows]):
        return
    scale, misfit = similarity_fit(modelled.values[rows, :3], points[rows])
    right_mm = MM_PER_UNIT[unit] / scale
    right = min(MM_PER_UNIT, key=lambda word: abs(math.log(MM_PER_UNIT[word] / right_mm)))
    if misfit <= NEAR and right != unit:
        raise ShotsInvalid(
            f"{where}: the points look like {UNITS.get(right, 'millimetres')}, not {unit}",
            remedy=f"import with --unit {right}",
        )


def check_distances(nominal: Kinematics, shots: Shots, limit_mm: float, where: str) -> None:
    """Raise `ShotsInvalid` for a point farther from where the nominal robot puts it than a gate.

    The same gate that a run has, after the best rigid fit of the greater part.
    """
    modelled = nominal.forward(shots.joints)
    rows = np.flatnonzero(modelled.found & np.isfinite(shots.points_in_tracker_mm).all(axis=1))
    if len(rows) < FEWEST:
        return
    positions, points = modelled.values[rows, :3], shots.points_in_tracker_mm[rows]
    part = _greater_part(positions, points, scaled=False)
    _, left = _similarity(positions, points, part, scaled=False)
    off_mm = np.linalg.norm(left, axis=1)
    worst = int(np.argmax(off_mm))
    if off_mm[worst] > limit_mm:
        raise ShotsInvalid(
            f"{where}: shot {shots.numbers[rows[worst]]}: its point is {off_mm[worst]:.0f} mm from "
            f"where the nominal robot puts it, limit {limit_mm:g} mm",
            remedy="a wrong target or wrong joints: correct the row or leave it out; a robot that "
            "is so far off needs a larger gate.distance_mm",
        )


def _check_joints(nominal: Kinematics, shots: Shots, where: str) -> None:
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
    nominal: Kinematics,
    shots: Shots,
    where: str,
    place_mm: Vector3 | None,
    modelled: KinematicSolution | None,
) -> None:
    points = shots.points_in_tracker_mm
    if len(points) < FEWEST or _on_a_line(points):
        return
    modelled = modelled or nominal.forward(shots.joints)
    unchanged = _unchanged(nominal, shots.joints, points, modelled)
    _check_crossbar(nominal, shots, where, unchanged.cost)
    if unchanged.cost <= NEAR:
        if place_mm is not None:
            _check_arms(nominal, shots, where, place_mm)
        return
    rows = np.unique(np.linspace(0, len(points) - 1, SAMPLE).astype(int))
    tried = sorted(
        _all_readings(nominal, shots.joints, points, rows, place_mm), key=lambda each: each.cost
    )
    best = tried[0].cost
    if best <= BETTER * unchanged.cost and best <= IMPOSSIBLE:
        alike = [each for each in tried if each.cost <= AS_GOOD * max(best, 0.5 * NEAR)]
        alike.sort(key=lambda each: MIRRORED not in each.words)  # the likelier of the two
        fewest = min(each.steps for each in alike)
        causes = {each.words: each for each in alike if each.steps == fewest and each.words}
        if causes:
            first = next(iter(causes.values()))
            # of the reflector's half is said what tells it from columns
            more = (each.remedy for each in causes.values() if each.remedy != first.remedy)
            remedy = next((each for each in more if first.remedy in each), first.remedy)
            raise ShotsInvalid(f"{where}: {' or '.join(causes)}", remedy=remedy)
    if unchanged.cost > IMPOSSIBLE:
        raise ShotsInvalid(
            f"{where}: the points do not follow the joints: after the best fit "
            f"{100.0 * min(unchanged.cost, 9.99):.0f} % of their spread is left, limit "
            f"{100.0 * IMPOSSIBLE:.0f} %",
            remedy="look at the order of rows, the order and signs of joints, and whether "
            "this is the robot of robot.yaml",
        )


def _check_crossbar(nominal: Kinematics, shots: Shots, where: str, cost: float) -> None:
    """Raise `ShotsInvalid` for a reflector on a half of the plate, not in the crossbar's middle.

    And the other way about. Of two halves `_half_words` tells.
    """
    controlled = nominal.mechanism.seen_from(None)
    if controlled.platform.arms_at_point or not controlled.platform.has_two_parts:
        return
    said = nominal.mechanism.platform.arms_at_point
    costs = {said: cost}
    for seen in map(controlled.seen_from, (None, 1, 2)):
        if seen.platform.arms_at_point != said:
            robot = replace(nominal, mechanism=seen)
            found = _unchanged(robot, shots.joints, shots.points_in_tracker_mm)
            costs[seen.platform.arms_at_point] = found.cost
    on = min(costs, key=costs.__getitem__)
    if costs[on] > min(BETTER * cost, NEAR) or (on and said):
        return
    cause, remedy = _on_half(1 + on[0] // 2) if on else IN_THE_MIDDLE
    raise ShotsInvalid(f"{where}: {cause}", remedy=remedy)


def _unchanged(
    nominal: Kinematics, joints: Array, points: Array, modelled: KinematicSolution | None = None
) -> Reading:
    """Return the reading of joints and points as they are written."""
    return next(_readings(nominal, joints, points, "", modelled=modelled))


def _on_a_line(points: Array) -> bool:
    spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
    return bool(spread[1] <= THIN * spread[0])


def _all_readings(
    nominal: Kinematics, joints: Array, points: Array, rows: Index, place_mm: Vector3 | None
) -> Iterator[Reading]:
    """Return readings with other units, orders and signs of joints, and a mirrored frame."""
    axes = nominal.mechanism.joints
    yield from _readings(nominal, joints, points, "")
    some, where = joints[rows], points[rows]
    if all(axis.is_revolute for axis in axes):
        in_degrees = np.degrees(some)
        words = "the joints look like radians"
        yield from _readings(nominal, in_degrees, where, words, "give the joints in degrees")
    straight = tuple(range(len(axes)))
    signs = tuple(product((1.0, -1.0), repeat=len(axes)))
    turned = [(straight, each) for each in signs]
    swapped = [(order, signs[place]) for order in permutations(straight) for place in (0, -1)]
    for order, sign in dict.fromkeys([*turned, *swapped]):
        if order == straight and min(sign) > 0.0:
            continue
        words = " and ".join(_joint_words(axes_order=order, sign=sign))
        read, remedy = some[:, order] * np.array(sign), COLUMNS
        if order == SWAPPED and min(sign) > 0.0 and nominal.mechanism.platform.arms_at_point:
            words, remedy = _half_words(nominal, words, read, where, place_mm)
        yield from _readings(nominal, read, where, words, remedy)


def _on_other_half(nominal: Kinematics) -> tuple[str, str]:
    """Return the cause and remedy of a reflector on the half that the robot file does not say."""
    return _on_half(2 if nominal.mechanism.platform.arms_at_point[0] == 0 else 1)


def _on_half(half: int) -> tuple[str, str]:
    return (
        f"the reflector seems to be on half {half} of the plate",
        f"say reflector_half: {half} in robot.yaml",
    )


def _half_words(
    nominal: Kinematics, words: str, joints: Array, points: Array, place_mm: Vector3 | None
) -> tuple[str, str]:
    """Return cause and remedy of joints that fit with the arms of the parts swapped.

    A reflector on the other part turns the tracker's place about the robot's axis by 180°, columns
    that are swapped leave it where it is.
    """
    half, remedy = _on_other_half(nominal)
    if place_mm is not None:
        found_mm = tracker_place_mm(nominal, joints, points)
        by_columns_mm = math.dist(found_mm, place_mm)
        by_half_mm = math.dist(_turned_mm(found_mm, math.pi), place_mm)
        if by_columns_mm < NEARER * by_half_mm:
            return words, COLUMNS
        if by_half_mm < NEARER * by_columns_mm:
            return half, remedy
    tells = "correct tracker.place_mm, which tells"
    return f"{half}, or {words}", f"{tells}; then {remedy}, or {COLUMNS}"


def _check_arms(nominal: Kinematics, shots: Shots, where: str, place_mm: Vector3) -> None:
    """Raise `ShotsInvalid` where the tracker's place shows that the arms are others than named.

    A symmetrical robot fits as well with its arms moved on; the tracker is then found elsewhere.
    """
    joints, points = shots.joints, shots.points_in_tracker_mm
    found_mm = tracker_place_mm(nominal, joints, points)
    off_mm, arms = math.dist(found_mm, place_mm), len(nominal.mechanism.joints)
    for step in (1, 2) if arms == OF_ONE_PART else (2,):
        turned_mm = _turned_mm(found_mm, 2.0 * math.pi * step / arms)
        if not (off_mm >= FAR_MM and math.dist(turned_mm, place_mm) <= NEARER * off_mm):
            continue
        order = tuple((arm - step) % arms for arm in range(arms))
        cause, remedy = " and ".join(_joint_words(axes_order=order, sign=(1.0,) * arms)), COLUMNS
        platform = nominal.mechanism.platform
        if platform.has_two_parts and platform.arms_at_point:
            half, remedy = _on_other_half(nominal)
            cause = f"{half} and columns swapped"
        elif min(each.cost for each in _readings(nominal, joints[:, order], points, "")) > NEAR:
            continue
        x, y, z = found_mm.tolist()
        raise ShotsInvalid(
            f"{where}: the tracker is found at ({x:.0f}, {y:.0f}, {z:.0f}) mm, "
            f"{off_mm / MM_PER_UNIT['m']:.1f} m from tracker.place_mm and turned from it by "
            f"{360 * step // arms}° about the robot's axis",
            remedy=f"correct tracker.place_mm; if that is right, {cause}: {remedy}",
        )


def tracker_place_mm(nominal: Kinematics, joints: Array, points: Array) -> Array:
    """Return the tracker's place (3,) in the base frame, by joints (N, n) and its points (N, 3).

    NaN where they do not tell.
    """
    modelled = nominal.forward(joints)
    positions, measured = modelled.values[modelled.found, :3], points[modelled.found]
    if len(measured) < FEWEST:
        return np.full(3, np.nan)
    rows = _greater_part(positions, measured, scaled=False)
    with suppress(ValueError):  # of points on a line
        return fit_transform(positions[rows], measured[rows]).inverted().translation_mm
    return np.full(3, np.nan)


def _turned_mm(place_mm: Array, angle_rad: float) -> Array:
    """Return the place (3,) turned about the base frame's z axis."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    x, y, z = place_mm.tolist()
    return np.array([cos * x - sin * y, sin * x + cos * y, z])


def _joint_words(*, axes_order: tuple[int, ...], sign: tuple[float, ...]) -> Iterator[str]:
    if axes_order != tuple(range(len(axes_order))):
        yield f"the joints seem to stand in the order {', '.join(f'q{q}' for q in axes_order)}"
    if max(sign) < 0.0:
        yield "all joints seem to have the other sign"
    elif min(sign) < 0.0:
        wrong = ", ".join(f"q{place}" for place, each in enumerate(sign) if each < 0.0)
        yield f"the sign of {wrong} seems to be turned"


def _readings(
    nominal: Kinematics,
    joints: Array,
    points: Array,
    words: str,
    remedy: str = "",
    modelled: KinematicSolution | None = None,
) -> Iterator[Reading]:
    """Return readings of joints (N, n) with every unit of the points, mirrored and not.

    The first one takes points as they are written.
    """
    modelled = modelled or nominal.forward(joints)
    rows = np.flatnonzero(modelled.found)
    if len(rows) < FEWEST:
        yield Reading(words, remedy, math.inf, 1 if words else 0)
        return
    lost = 0.5 * (1.0 - len(rows) / len(joints))
    for mirrored in (False, True):
        measured = points[rows] * (np.array([1.0, 1.0, -1.0]) if mirrored else 1.0)
        scale, misfit = similarity_fit(modelled.values[rows, :3], measured)
        nearest = min(FACTORS, key=lambda each: abs(math.log(scale / each)))
        for unit in (1.0, nearest):
            causes = [words] if words else []
            remedies = [remedy] if remedy else []
            if mirrored:
                causes.append(MIRRORED)
                remedies.append("turn the sign of one coordinate, such as z")
            if unit != 1.0:
                cause, way = _unit_words(unit)
                causes.append(cause)
                remedies.append(way)
            cost = math.hypot(misfit, math.log(scale / unit)) + lost
            yield Reading(" and ".join(causes), "; ".join(remedies), cost, len(causes))


def _unit_words(factor: float) -> tuple[str, str]:
    """Return the cause and remedy of points in another unit, or too large or small by a factor."""
    for unit, words in UNITS.items():
        if 1.0 / MM_PER_UNIT[unit] == factor:
            return (
                f"the points look like {words}",
                f"import with --unit {unit}, or give millimetres",
            )
    cause = f"distances between the points are {factor:g} times those of the nominal robot"
    return cause, "give millimetres as measured, neither doubled nor halved"


def similarity_fit(modelled: Array, measured: Array) -> tuple[float, float]:
    """Return the scale of the best similarity with the greater part of measured points.

    And its misfit: root mean square left over the points' spread.
    """
    rows = _greater_part(modelled, measured, scaled=True)
    scale, left = _similarity(modelled, measured, rows, scaled=True)
    size = float(np.linalg.norm(measured[rows] - measured[rows].mean(axis=0)))
    return scale, float(np.linalg.norm(left[rows])) / size if size > 0.0 else math.inf


def _greater_part(modelled: Array, measured: Array, *, scaled: bool) -> Index:
    """Return rows that fit best together, leaving out the worst in rounds (trimmed squares)."""
    rows = np.arange(len(modelled))
    keep = max(FEWEST - 1, int(KEPT * len(modelled)))
    for _ in range(TRIMMINGS):
        _, left = _similarity(modelled, measured, rows, scaled=scaled)
        rows = np.sort(np.argsort(np.linalg.norm(left, axis=1), kind="stable")[:keep])
    return rows


def _similarity(
    modelled: Array, measured: Array, rows: Index, *, scaled: bool
) -> tuple[float, Array]:
    """Return the scale of the best similarity of some rows (Umeyama 1991), and all residuals."""
    a, b = (points - points[rows].mean(axis=0) for points in (modelled, measured))
    rotation, spread = best_rotation(a[rows], b[rows])
    size = float(np.sum(a[rows] ** 2))
    scale = float(np.sum(spread)) / size if scaled and size > 0.0 else 1.0
    scale = max(scale, np.finfo(np.float64).tiny)
    return scale, np.asarray(b - scale * a @ rotation.T)
