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

import numpy as np

from campaigns.arrays import Array
from campaigns.evaluation.joint_maps import Causes, plain_maps
from campaigns.evaluation.pieces import FEWEST_SHOTS, JUDGED_SHARE, greater_part, similarity_fit
from campaigns.fit.rigid_transforms import fit_transform
from campaigns.kinematics.model import Kinematics
from campaigns.shots.point_words import MM_PER_UNIT, LengthUnit
from drivers.values import JOINT_ANGLE

UNITS: Mapping[LengthUnit, str] = {
    "mm": "millimetres",
    "m": "metres",
    "cm": "centimetres",
    "inch": "inches",
    "ft": "feet",
    "um": "micrometres",
}
MIRRORED = ("the frame of the points is mirrored", "turn the sign of one coordinate, such as z")


@dataclass(frozen=True, slots=True, eq=False)
class Reading:
    """Way in which joints and points may have been meant."""

    causes: Causes
    joints: Array
    """Joints so read, of all shots (N, n), rad and mm."""
    of_columns: Causes
    """Those of the causes that are the columns of the joints."""
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
        return "; ".join(dict.fromkeys(remedy for _, remedy in self.causes))

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
    # Where most shots would have a joint beyond what any joint has, it is no reading. Degrees taken
    # for radians are such, and the robot's model would search long for poses there.
    axes = nominal.mechanism.joints
    most = [math.radians(JOINT_ANGLE.most) if axis.is_revolute else math.inf for axis in axes]
    as_written, *others = ((plain, plain.joints(joints)) for plain in plain_maps(axes))
    possible = [
        (plain, meant)
        for plain, meant in others
        if (np.quantile(np.abs(meant), JUDGED_SHARE, axis=0) <= most).all()
    ]
    return {plain.causes(axes, joints): meant for plain, meant in (as_written, *possible)}


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
            yield Reading(causes, meant[of_joints], of_joints, math.inf, reached, seen)
            continue
        cost_of_lost = 0.5 * (1.0 - len(seen) / len(points))
        mirrored = seen * np.array([1.0, 1.0, -1.0])
        for of_frame, measured in (((), seen), ((MIRRORED,), mirrored)):
            for reading in _readings_by_unit(reached, measured, unit):
                yield replace(
                    reading,
                    causes=(*causes, *of_frame, *reading.causes),
                    joints=meant[of_joints],
                    of_columns=of_joints,
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
        yield Reading(causes, np.empty(0), (), cost, positions, points / factor)


def _unit_cause(factor: float, unit: LengthUnit) -> tuple[str, str]:
    """Return cause and remedy of points that are too large by a unit's factor, read in a unit."""
    right = min(UNITS, key=lambda right: abs(MM_PER_UNIT[unit] / MM_PER_UNIT[right] - factor))
    return f"the points look like {UNITS[right]}, not {unit}", f"import with --unit {right}"
