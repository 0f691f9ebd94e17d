"""Readings of measured shots: the ways in which joints and points may have been meant.

People get files wrong in few ways: joints in radians, of the other sign or in another order; the
reflector on the other half of the plate; the frame mirrored; lengths in another unit. Each reading
has a cost, the misfit that is left after the best similarity (rigid motion and scale), in parts of
the points' spread. A few gross errors must not decide: every fit is of the four fifths of the shots
that agree best.
"""

import math
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import combinations, permutations, product

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.fit.rigid_transforms import best_rotation, fit_transform
from campaigns.kinematics.model import Kinematics
from campaigns.shots.point_words import MM_PER_UNIT, LengthUnit

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
JUDGED_SHARE = 0.8
"""Share of the shots by which a fit is judged, so that a few gross errors do not decide."""
TRIMMING_ROUNDS = 5
MOST_IN_ANY_ORDER = 4
"""Joints up to which every order is tried."""
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
            rows = greater_part(self.positions_mm, self.points_mm, scaled=False)
            fitted = fit_transform(self.positions_mm[rows], self.points_mm[rows])
            return fitted.inverted().translation_mm
        return np.full(3, np.nan)


def halves(nominal: Kinematics) -> Iterator[tuple[Causes, Kinematics]]:
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


def joint_readings(nominal: Kinematics, joints: Array) -> dict[Causes, Array]:
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
        if words := " and ".join(joint_words(order, sign)):
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


def joint_words(order: tuple[int, ...], sign: tuple[float, ...]) -> Iterator[str]:
    """Yield what is different about joints in an order and of signs, in words."""
    if order != tuple(range(len(order))):
        yield f"the joints seem to stand in the order {', '.join(f'q{q}' for q in order)}"
    if max(sign) < 0.0:
        yield "all joints seem to have the other sign"
    elif min(sign) < 0.0:
        wrong = ", ".join(f"q{place}" for place, factor in enumerate(sign) if factor < 0.0)
        yield f"the sign of {wrong} seems to be turned"


def each_reading(
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
# unit explains adds to the misfit.
def _readings_by_unit(positions: Array, points: Array, unit: LengthUnit) -> Iterator[Reading]:
    """Yield the reading of points (M, 3) in their unit, and that in the unit nearest to the fit."""
    factors = [MM_PER_UNIT[unit] / MM_PER_UNIT[right] for right in UNITS]
    scale, misfit = similarity_fit(positions, points)
    nearest = min(factors, key=lambda factor: abs(math.log(scale / factor)))
    for factor in dict.fromkeys((1.0, nearest)):
        causes = () if factor == 1.0 else (_unit_cause(factor, unit),)
        cost = math.hypot(misfit, math.log(scale / factor))
        yield Reading(causes, cost, positions, points / factor)


def _unit_cause(factor: float, unit: LengthUnit) -> tuple[str, str]:
    """Return cause and remedy of points that are too large by a unit's factor, read in a unit."""
    right = min(UNITS, key=lambda right: abs(MM_PER_UNIT[unit] / MM_PER_UNIT[right] - factor))
    return f"the points look like {UNITS[right]}, not {unit}", f"import with --unit {right}"


def similarity_fit(modelled: Array, measured: Array) -> tuple[float, float]:
    """Return the scale of the best similarity with the greater part of the points, and its misfit.

    The misfit is the root mean square residual in parts of the points' spread.
    """
    rows = greater_part(modelled, measured, scaled=True)
    scale, residuals = similarity(modelled, measured, rows, scaled=True)
    size = float(np.linalg.norm(measured[rows] - measured[rows].mean(axis=0)))
    return scale, float(np.linalg.norm(residuals[rows])) / size if size > 0.0 else math.inf


def greater_part(modelled: Array, measured: Array, *, scaled: bool) -> Index:
    """Return the rows that fit best together, without the worst ones (trimmed least squares)."""
    # Fit, keep the rows with the smallest residuals, fit again to these: each round can only lower
    # the trimmed sum of squares. Rows that were left out may come back.
    rows = np.arange(len(modelled))
    keep = max(FEWEST_SHOTS - 1, int(JUDGED_SHARE * len(modelled)))
    for _ in range(TRIMMING_ROUNDS):
        _, residuals = similarity(modelled, measured, rows, scaled=scaled)
        rows = np.sort(np.argsort(np.linalg.norm(residuals, axis=1), kind="stable")[:keep])
    return rows


def similarity(
    modelled: Array, measured: Array, rows: Index, *, scaled: bool
) -> tuple[float, Array]:
    """Return the scale of the best similarity of some rows (Umeyama 1991), and all residuals."""
    a, b = (points - points[rows].mean(axis=0) for points in (modelled, measured))
    rotation, spread = best_rotation(a[rows], b[rows])
    size = float(np.sum(a[rows] ** 2))
    scale = float(np.sum(spread)) / size if scaled and size > 0.0 else 1.0
    scale = max(scale, np.finfo(np.float64).tiny)  # its logarithm is taken
    return scale, np.asarray(b - scale * a @ rotation.T)
