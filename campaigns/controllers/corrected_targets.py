"""Corrected targets: what to command a controller that keeps its nominal parameters.

With the identified model K and the controller's own K0 a wanted pose x has the joints
q = inverse(K, x); commanded x' = forward(K0, q) makes the controller set these very joints
(model.md, family).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array
from campaigns.design.restricted_space import ROUNDING_MM, UNRESTRICTED, RestrictedSpace
from campaigns.errors import TargetsInvalid
from campaigns.files.csv_file import CsvColumn, CsvForm, csv_text, number_text, parse_csv
from campaigns.identification.positions import std_of_positions
from campaigns.identification.result import ParameterCovariance
from campaigns.kinematics.feasibility import Limits
from campaigns.kinematics.mechanism import Kinematics, KinematicSolution
from campaigns.kinematics.transmission import approach_along
from campaigns.shots.columns import axis_columns, axis_texts, columns_of

NAME = "name"


@dataclass(frozen=True, slots=True, eq=False)
class TargetCorrection:
    """Correction of targets from an identified model to the controller's."""

    identified: Kinematics
    nominal: Kinematics
    limits: Limits
    space: RestrictedSpace = UNRESTRICTED
    uncertainty: ParameterCovariance | None = None
    """Of the identified parameters; None if unknown."""
    measured: Array | None = None
    """Poses (M, t) of the shots, whose best fit is the frame."""

    def approach(self, wanted: Array) -> Array:
        """Return the sign of each joint's last motion at poses (N, t) reached one after another.

        (N, n), 0 until a joint moves. Joints turn round at poses only.
        """
        return approach_along(self.identified.inverse(wanted).values)

    def commanded(self, wanted: Array, approach: Array | None = None) -> KinematicSolution:
        """Return the poses (N, t) to command for wanted ones that joints reach by `approach`."""
        joints = self.identified.inverse(wanted, approach)
        is_solved = joints.is_solved.copy()
        values = np.full_like(wanted, np.nan)
        poses = self.nominal.forward(joints.values[is_solved], wanted[is_solved])
        values[is_solved] = poses.values
        is_solved[is_solved] = poses.is_solved
        return KinematicSolution.where(is_solved, values)

    def require_possible(self, wanted: Array, place: Callable[[int], str]) -> None:
        """Raise `TargetsInvalid` for the first of the poses (N, t) that the robot cannot take.

        The real robot's limits count, at the joints that it will have. `place` names a row.
        """
        judged = self.identified.feasibility(self.limits, wanted)
        is_possible = judged.feasible & self.commanded(wanted).is_solved
        is_possible &= (self.space.clearance_mm(wanted[:, :3]) >= -ROUNDING_MM).all(axis=1)
        if is_possible.all():
            return
        row = int(np.argmin(is_possible))
        reasons = (*judged.describe(row), self.space.fault(wanted[row, :3]))
        unreachable = "the controller's own kinematics cannot be assembled there"
        reason = next(filter(None, reasons), unreachable)
        raise TargetsInvalid(f"{place(row)}: {reason}", remedy="change the pose")

    def std_mm(self, wanted: Array) -> Array:
        """Return 1 σ of the position at wanted poses (N, t), (N,); NaN where it is unknown."""
        if self.uncertainty is None or self.measured is None:
            return np.full(len(wanted), np.nan)
        return std_of_positions(self.identified, self.uncertainty, wanted, self.measured)


@dataclass(frozen=True, slots=True)
class CorrectedFile:
    """Text of a corrected file, and the sizes of its corrections."""

    text: str
    targets: int
    correction_mm: tuple[float, float]
    """Mean and largest correction of a position."""
    std_mm: float | None
    """Largest 1 σ of a position among them; None if unknown."""


def correct_poses(text: str, name: str, correction: TargetCorrection) -> CorrectedFile:
    """Read the wanted poses of a CSV file's text, and write what to command for each.

    Poses are reached one after another, and joints turn round at targets only. Raise
    `TargetsInvalid` naming the first line that is wrong or cannot be taken.
    """
    task = correction.identified.mechanism.task
    columns = axis_columns(task)
    rows = list(
        parse_csv(text, name, CsvForm((*columns_of(task), CsvColumn(NAME)), TargetsInvalid))
    )
    if not rows:
        raise TargetsInvalid(f"{name}: holds no poses", remedy="give a row for each pose")
    names = [row.text(NAME) for row in rows]
    wanted = np.array([row.values(columns) for row in rows])

    def place(row: int) -> str:
        return f"{rows[row].where}: {names[row]}" if names[row] else rows[row].where

    correction.require_possible(wanted, place)
    commanded = correction.commanded(wanted, correction.approach(wanted)).values_or_raise()
    sizes_mm = np.linalg.norm(commanded[:, :3] - wanted[:, :3], axis=1)
    std_mm = correction.std_mm(wanted)
    turns = [column for column, axis in enumerate(task) if axis.is_revolute]
    turns_deg = np.degrees(commanded - wanted)[:, turns]
    further = np.column_stack([sizes_mm, turns_deg, std_mm]).tolist()
    head = (
        NAME,
        *columns,
        *(f"commanded_{column}" for column in columns),
        "correction_mm",
        *(f"correction_{task[column].column}" for column in turns),
        "position_std_mm",
    )
    lines = [
        [
            row_name,
            *axis_texts(task, pose),
            *(_rounded(axis.to_file(value)) for axis, value in zip(task, command, strict=True)),
            *map(_rounded, values),
        ]
        for row_name, pose, command, values in zip(
            names, wanted.tolist(), commanded.tolist(), further, strict=True
        )
    ]
    return CorrectedFile(
        csv_text(head, lines),
        len(rows),
        (float(sizes_mm.mean()), float(sizes_mm.max())),
        None if np.isnan(std_mm).any() else float(std_mm.max()),
    )


def _rounded(value: float) -> str:
    return "" if np.isnan(value) else number_text(round(value, 6))
