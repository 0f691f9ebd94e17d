"""Corrected targets: poses to command to a controller that keeps its nominal parameters."""

# Many controllers take no parameters. Their own model K0 stays nominal, and it alone turns a
# commanded pose into joints. To bring the real robot, identified as K, to a wanted pose x:
#
#     q  = inverse(K, x)     the joints at which the real robot stands at x
#     x' = forward(K0, q)    the pose for which the controller computes those joints
#
# The program then commands x' instead of x. The correction is exact at the targets, also for what
# no parameter of K0 can express: tilts, gear errors and backlash. Between two targets the
# controller moves by K0, so the path is no better than before.

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from campaigns.arrays import AXES, Array
from campaigns.design.restricted_space import ROUNDING_MM, UNRESTRICTED, RestrictedSpace
from campaigns.errors import TargetsInvalid
from campaigns.files.csv_file import CsvColumn, CsvForm, CsvRow, csv_text, number_text, parse_csv
from campaigns.identification.positions import std_of_positions, std_of_rotations
from campaigns.identification.result import ParameterCovariance, PositionStd, StoredLayer
from campaigns.kinematics.axes import TURNS, Axis
from campaigns.kinematics.feasibility import Limits
from campaigns.kinematics.model import Kinematics, KinematicSolution
from campaigns.kinematics.transmission import approach_along
from campaigns.shots.columns import axis_columns, axis_texts, axis_values, columns_of, in_files
from campaigns.shots.turn_forms import TurnForm, foreign_columns, turn_values, turns_of

NAME = "name"


@dataclass(frozen=True, slots=True, eq=False)
class TargetCorrection:
    """Correction of targets from an identified model to the controller's."""

    identified: Kinematics
    """Model of the real robot."""
    nominal: Kinematics
    """Model that the controller computes with."""
    limits: Limits
    """Limits of the real robot's joints and passive joints."""
    space: RestrictedSpace = UNRESTRICTED
    uncertainty: ParameterCovariance | None = None
    """Covariance of the identified parameters; None if unknown."""
    measured: Array | None = None
    """Poses (M, t) of the identification shots, which fix the frame of `std_mm`; None if unknown.
    """
    layers: tuple[StoredLayer, ...] = ()
    """Errors of the real robot that no parameter describes."""
    positions: PositionStd | None = None
    """σ of positions of the identification, which says what the layers leave unknown."""

    def approach(self, wanted: Array) -> Array:
        """Return the sign of each joint's last motion at poses (N, t) reached one after another.

        The signs are (N, n), 0 until a joint moves. Joints are assumed to reverse at poses only.
        """
        return approach_along(self.identified.inverse(wanted).values)

    def commanded(self, wanted: Array, approach: Array | None = None) -> KinematicSolution:
        """Return the poses (N, t) to command so that the robot stands at the wanted poses (N, t).

        `approach` (N, n) is the sign of each joint's last motion; None: backlash is left out.
        """
        joints = self._joints(wanted, approach)
        is_solved = joints.is_solved.copy()
        values = np.full_like(wanted, np.nan)
        # iteration from the wanted pose selects the assembly that the real robot has
        poses = self.nominal.forward(joints.values[is_solved], wanted[is_solved])
        values[is_solved] = poses.values
        is_solved[is_solved] = poses.is_solved
        return KinematicSolution.where(is_solved, values)

    # The real robot stands at x where its parameters alone put it at x less what layers add there,
    # and its joints are off by what layers add to their angles. Both vary slowly: a second round is
    # exact to their slope squared.
    def _joints(self, wanted: Array, approach: Array | None) -> KinematicSolution:
        """Return the joints (N, n) at which the real robot stands at the wanted poses (N, t)."""
        solution = self.identified.inverse(wanted, approach)
        if not self.layers:
            return solution
        for _ in range(2):
            poses, shifts = wanted.copy(), np.zeros_like(solution.values)
            for layer in self.layers:
                moved = layer.moves_at(np.nan_to_num(solution.values), wanted)
                if layer.kind == "place":
                    poses[:, :3] -= moved
                else:
                    shifts += moved
            inverse = self.identified.inverse(poses, approach)
            solution = KinematicSolution(inverse.values - shifts, inverse.is_solved)
        return solution

    def require_possible(self, wanted: Array, place: Callable[[int], str]) -> None:
        """Raise `TargetsInvalid` for the first of the poses (N, t) that the robot cannot take.

        `place` returns the name of a row, for the message.
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
        std = std_of_positions(self.identified, self.uncertainty, wanted, self.measured)
        if self.positions is None or self.positions.corrected is None:
            return std
        # what layers leave unknown is stated for the whole workspace
        about = std_of_positions(self.identified, self.uncertainty, self.measured, self.measured)
        beyond = max(self.positions.corrected**2 - float((about**2).mean()), 0.0)
        return np.asarray(np.hypot(std, beyond**0.5))

    def rotation_std_deg(self, wanted: Array) -> Array | None:
        """Return 1 σ of the tool's rotation at wanted poses (N, t), (N,), deg; NaN if unknown.

        None for a robot without turns.
        """
        if len(self.identified.mechanism.task) == len(AXES):
            return None
        if self.uncertainty is None or self.measured is None:
            return np.full(len(wanted), np.nan)
        return std_of_rotations(self.identified, self.uncertainty, wanted, self.measured)


@dataclass(frozen=True, slots=True)
class CorrectedFile:
    """Text of a corrected file, and the sizes of its corrections."""

    text: str
    targets: int
    """Number of targets in the file."""
    correction_mm: tuple[float, float]
    """Mean and largest correction of a position."""
    std_mm: float | None
    """Largest 1 σ of a corrected position; None if unknown."""


def correct_poses(
    text: str, name: str, correction: TargetCorrection, form: TurnForm | None = None
) -> CorrectedFile:
    """Correct the wanted poses of a CSV file's text, and return the text of the corrected file.

    `form` is that of three turns; None: by their columns. Poses are reached in the order of the
    rows. Raise `TargetsInvalid` naming the first line that is wrong, or whose pose the robot cannot
    take.
    """
    task = correction.identified.mechanism.task
    columns = axis_columns(task)
    rows = list(parse_csv(text, name, _form(task)))
    if not rows:
        raise TargetsInvalid(f"{name}: holds no poses", remedy="give a row for each pose")
    names = [row.text(NAME) for row in rows]
    wanted = np.array([_wanted(row, task, form) for row in rows])

    def place(row: int) -> str:
        """Return the line of the file, with the name of the pose if it has one."""
        return f"{rows[row].where}: {names[row]}" if names[row] else rows[row].where

    correction.require_possible(wanted, place)
    commanded = correction.commanded(wanted, correction.approach(wanted)).values_or_raise()
    sizes_mm = np.linalg.norm(commanded[:, :3] - wanted[:, :3], axis=1)
    std_mm = correction.std_mm(wanted)
    turns = {
        f"correction_{name}_deg": np.degrees(values)
        for name, values in _turned(task, wanted, commanded).items()
    }
    rotation_std = correction.rotation_std_deg(wanted)
    std = {"position_std_mm": std_mm}
    if rotation_std is not None:
        std["rotation_std_deg"] = rotation_std
    further = np.column_stack([sizes_mm, *turns.values(), *std.values()]).tolist()
    head = (
        NAME,
        *columns,
        *(f"commanded_{column}" for column in columns),
        "correction_mm",
        *turns,
        *std,
    )
    lines = [
        [
            row_name,
            *axis_texts(task, pose),
            *(_rounded(value) for value in in_files(task, command)),
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


def _form(task: Sequence[Axis]) -> CsvForm:
    """Return the columns of a file of targets: coordinates, three turns in any form, and names."""
    foreign = foreign_columns(task)
    places, turns = columns_of(task[: len(AXES)]), columns_of(turns_of(task), required=not foreign)
    return CsvForm((*places, *turns, *foreign, CsvColumn(NAME)), TargetsInvalid)


def _wanted(row: CsvRow, task: Sequence[Axis], form: TurnForm | None) -> tuple[float, ...]:
    """Return the pose (t,) of a row, mm and rad; raise `TargetsInvalid`."""
    if turns_of(task) != TURNS:
        return axis_values(row, task)
    if not (turn := turn_values(row, task, form)):
        names = ",".join(axis_columns(turns_of(task)))
        raise row.wrong(f"no turn: {names} are missing or empty", remedy="give the whole pose")
    return (*axis_values(row, task[: len(AXES)]), *turn)


# Rotation vectors are no vectors: the way from one to the other is a rotation of its own.
def _turned(task: Sequence[Axis], wanted: Array, commanded: Array) -> dict[str, Array]:
    """Return by how much poses (N, t) to command are turned from the wanted ones, (N,), rad.

    By name: of one turn the difference with its sign, of three the size of the turn between them.
    """
    before, after = wanted[:, len(AXES) :], commanded[:, len(AXES) :]
    if turns_of(task) != TURNS:
        names = (axis.name for axis in turns_of(task))
        return dict(zip(names, (after - before).T, strict=True))
    rotation = scipy.spatial.transform.Rotation
    turned = rotation.from_rotvec(after) * rotation.from_rotvec(before).inv()
    return {"rotation": np.asarray(turned.magnitude())}


def _rounded(value: float) -> str:
    """Write a number with six decimals, and NaN as an empty cell."""
    return "" if np.isnan(value) else number_text(round(value, 6))
