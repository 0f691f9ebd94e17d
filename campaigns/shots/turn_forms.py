"""Turns of platforms with three of them, as our files and other software write them.

Ours are a rotation vector, `rx_deg ry_deg rz_deg`. Others write three angles, whose order no file
states, or a quaternion. With Rx the turn about x, and so on:

    xyz         R = Rx Ry Rz: about x, then the turned y, then the turned z
    zyx         R = Rz Ry Rx: KUKA's A B C, Fanuc's W P R, roll pitch yaw
    quaternion  qw + qx i + qy j + qz k
    vector      the axis times the angle
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import scipy

from campaigns.errors import ShotsInvalid
from campaigns.files.csv_file import (
    CsvColumn,
    CsvForm,
    CsvRow,
    angle_column,
    column_names,
    number_column,
)
from campaigns.kinematics.axes import TURNS, Axis
from drivers.bounded_files import CSV_BYTES, FileRefused, codec_of, read_bounded

TurnForm = Literal["xyz", "zyx", "quaternion", "vector"]
OURS = tuple(axis.column for axis in TURNS)
"""Columns of a rotation vector, unless another form is named."""
OF_ANGLES = (
    ("w_deg", "p_deg", "r_deg"),
    ("c_deg", "b_deg", "a_deg"),
    ("roll_deg", "pitch_deg", "yaw_deg"),
)
"""Columns of other software: angles about x, y and z."""
QUATERNION = ("qw", "qx", "qy", "qz")
UNIT_LENGTH = 1e-3
"""Largest difference of a quaternion's length from 1: rounding is far below, a wrong cell above."""
REMEDY = f"say --turns {'|'.join(get_args(TurnForm))} (zyx: A B C, W P R, roll pitch yaw)"


def turns_of(task: Sequence[Axis]) -> tuple[Axis, ...]:
    """Return the task axes beyond a place, which a tracker does not see."""
    return tuple(task[3:])


def foreign_columns(task: Sequence[Axis]) -> tuple[CsvColumn, ...]:
    """Return the columns of other software for the turns of a robot that has three."""
    if turns_of(task) != TURNS:
        return ()
    angles = (angle_column(name) for names in OF_ANGLES for name in names)
    return (*angles, *map(number_column, QUATERNION))


def has_unknown_turns(path: Path) -> bool:
    """Return whether a file's first line names angles whose order no file states.

    A file that cannot be read has none: its reader says why.
    """
    with suppress(FileRefused, UnicodeDecodeError, ShotsInvalid):
        data = read_bounded(path, CSV_BYTES)
        form = CsvForm(tuple(angle_column(n) for names in OF_ANGLES for n in names), ShotsInvalid)
        named = column_names(data.decode(codec_of(data)), form)
        return any({*named}.issuperset(names) for names in OF_ANGLES)
    return False


def turn_values(row: CsvRow, task: Sequence[Axis], form: TurnForm | None) -> tuple[float, ...]:
    """Read the turns of a row, rad: () where it has none, a rotation vector of three.

    `form` is that of the columns; None: by their names. Raise the error of the file's kind.
    """
    turns = turns_of(task)
    if turns != TURNS:
        names = tuple(axis.column for axis in turns)
        return row.values(names) if any(map(row.text, names)) else ()
    stated = [names for names in (OURS, *OF_ANGLES, QUATERNION) if {*names} & row.texts.keys()]
    if len(stated) > 1:
        raise row.wrong(
            f"the turn is stated twice, by {stated[0][0]} and {stated[1][0]}",
            remedy="keep the columns of one",
        )
    if not stated or not any(map(row.text, stated[0])):
        return ()
    names = stated[0]
    if form is None and names in OF_ANGLES:
        raise row.wrong(f"{','.join(names)} may be turns in several orders", remedy=REMEDY)
    form = form or ("quaternion" if names == QUATERNION else "vector")
    if (form == "quaternion") != (names == QUATERNION):
        raise row.wrong(
            f"{','.join(names)} are no {form}",
            remedy=f"{REMEDY}; a quaternion has the columns {','.join(QUATERNION)}",
        )
    return _vector_of(row, dict(zip(names, row.values(names), strict=True)), form)


def _vector_of(row: CsvRow, values: Mapping[str, float], form: TurnForm) -> tuple[float, ...]:
    """Return the rotation vector of three angles about x, y and z, rad, or of a quaternion."""
    rotation, numbers = scipy.spatial.transform.Rotation, [*values.values()]
    if form == "vector":
        return tuple(numbers)
    if form == "quaternion":
        length = float(np.linalg.norm(numbers))
        if not abs(length - 1.0) <= UNIT_LENGTH:
            raise row.wrong(
                f"the quaternion's length is {length:.4g}, must be 1",
                remedy=f"check the columns {','.join(values)}",
            )
        turned = rotation.from_quat([*numbers[1:], numbers[0]])
    elif form == "xyz":
        turned = rotation.from_euler("XYZ", numbers)
    else:
        turned = rotation.from_euler("ZYX", numbers[::-1])
    return tuple(turned.as_rotvec().tolist())
