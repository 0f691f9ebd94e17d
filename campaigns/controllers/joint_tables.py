"""Joint tables: corrections of axes from either side, for controllers that compensate axes.

Of a reading q that is reached from side s, joints truly stand at q + f(q, s). A controller that
wants a joint at n commands the q with q + f(q, s) = n: tables hold q - n by n for both sides, by
even steps, and are read by straight lines between their points.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array
from campaigns.files.csv_file import csv_text, fixed_text
from campaigns.mechanisms.mechanism import Axis, Interval, Kinematics

SIDES = {"rising": 1.0, "falling": -1.0}
TOLERANCE_MM = 0.001
BEYOND_RAD = float(np.radians(1.0))
"""Of each limit, which a controller may pass a little; of carriages what compares."""
PARTS = 8
"""Of a spacing, at whose ends straight lines are compared with the corrections."""
FEWEST_POINTS = 9
MOST_POINTS = 10_000
LINUXCNC_POINTS = 256
"""Beyond, LinuxCNC says so once and leaves out the rest."""
SLACK = 1.02
DECIMALS = 9


@dataclass(frozen=True, slots=True, eq=False)
class JointTables:
    """Tables of all joints, rad or mm."""

    axes: tuple[Axis, ...]
    wanted: Array
    """Joints, the same of each axis, evenly spaced, (M,)."""
    corrections: Array
    """What is added to them, (2, M, n): of joints that grow, and of those that fall."""
    left_mm: float
    """Largest difference of the straight lines from the corrections, at the end of a crank."""

    def readings(self, joints: Array, approach: Array) -> Array:
        """Readings (N, n) to command for joints (N, n) that are reached by `approach` (N, n)."""
        by_joint = zip(joints.T, self.corrections.transpose(2, 0, 1), strict=True)
        rising, falling = np.array(
            [[np.interp(wanted, self.wanted, side) for side in sides] for wanted, sides in by_joint]
        ).transpose(1, 2, 0)
        share = 0.5 * (1.0 + np.sign(approach))
        return np.asarray(joints + share * rising + (1.0 - share) * falling)

    def rows(self, joint: int) -> list[tuple[str, ...]]:
        """Joint, and correction where it rises and where it falls, deg or mm."""
        columns = np.stack([self.wanted, *self.corrections[:, :, joint]], axis=1)
        to_file = self.axes[joint].to_file
        return [tuple(fixed_text(to_file(v), DECIMALS) for v in row) for row in columns.tolist()]


def joint_tables(
    kinematics: Kinematics,
    limits: Interval,
    tolerance_mm: float = TOLERANCE_MM,
    most_points: int = MOST_POINTS,
) -> JointTables:
    """Tables over the joints' limits, as fine as a tolerance at the cranks' ends asks.

    Where that takes more than `most_points`, so many, and what they leave is larger.
    """
    mechanism, p = kinematics.mechanism, kinematics.p
    levers_mm = mechanism.sensitivity_scale_mm(p)[mechanism.parameters.offsets]
    beyond = BEYOND_RAD * mechanism.joints[0].scale
    low, high = limits[0] - beyond, limits[1] + beyond

    def corrections(points: int) -> tuple[Array, Array]:
        wanted = np.linspace(low, high, points)
        joints = np.repeat(wanted[:, None], len(levers_mm), axis=1)
        of_sides = [
            mechanism.encoder_readings(p, joints, np.full_like(joints, side)) - joints
            for side in SIDES.values()
        ]
        return wanted, np.stack(of_sides)

    points = min(FEWEST_POINTS, most_points)
    while True:
        _, exact = corrections(PARTS * (points - 1) + 1)
        held, part = exact[:, ::PARTS], np.arange(PARTS) / PARTS
        lines = held[:, :-1, None] + part[:, None] * np.diff(held, axis=1)[:, :, None]
        away = np.abs(exact[:, :-1].reshape(lines.shape) - lines)
        left_mm = float((away * levers_mm).max())
        if left_mm <= tolerance_mm or points == most_points:
            return JointTables(mechanism.joints, *corrections(points), left_mm)
        more = SLACK * (points - 1) * np.sqrt(left_mm / tolerance_mm)
        points = min(max(points + 1, int(np.ceil(more)) + 1), most_points)


def _csv(tables: JointTables) -> dict[str, str]:
    """One file: a row a point, two columns a joint."""
    unit, joints = tables.axes[0].unit, range(len(tables.axes))
    columns = [f"{axis.name}_{side}_{axis.unit}" for axis in tables.axes for side in SIDES]
    rows = zip(*map(tables.rows, joints), strict=True)
    texts = [[row[0][0], *(text for _, *sides in row for text in sides)] for row in rows]
    return {"joint-tables.csv": csv_text((f"joint_{unit}", *columns), texts)}


def _linuxcnc(tables: JointTables) -> dict[str, str]:
    """A file of each joint; what it says of itself stands last, where LinuxCNC reads no more."""
    return {
        f"joint{joint}.comp": "".join(f"{' '.join(row)}\n" for row in tables.rows(joint))
        + f"# [JOINT_{joint}]: COMP_FILE = joint{joint}.comp, COMP_FILE_TYPE = 1\n"
        for joint in range(len(tables.axes))
    }


def _twincat(tables: JointTables) -> dict[str, str]:
    """Structured text of what MC_TableBasedPositionCompensation of Tc2_MC2 takes, by its manual."""
    lines = ["VAR_GLOBAL CONSTANT"]
    for joint, axis in enumerate(tables.axes):
        rows = tables.rows(joint)
        for place, (side, word) in enumerate(zip(SIDES, ("Positive", "Negative"), strict=True), 1):
            points = (f"    (Position := {r[0]}, Compensation := {r[place]})" for r in rows)
            lines += [
                f"  {axis.name}_{side}_parameter : ST_PositionCompensationTableParameter := (",
                f"    MinPosition := {rows[0][0]}, MaxPosition := {rows[-1][0]},",
                f"    NoOfTableElements := {len(rows)}, Direction := WorkDirection{word});",
                f"  {axis.name}_{side} : ARRAY[0..{len(rows) - 1}]",
                "    OF ST_PositionCompensationTableElement := [",
                ",\n".join(points) + "];",
            ]
    return {"joint-tables.st": "\n".join([*lines, "END_VAR", ""])}


FORMATS: Mapping[str, tuple[Callable[[JointTables], dict[str, str]], int]] = {
    "csv": (_csv, MOST_POINTS),
    "linuxcnc": (_linuxcnc, LINUXCNC_POINTS),
    "twincat": (_twincat, MOST_POINTS),
}
"""Forms in which controllers take tables: files by name, and how many points at most."""
