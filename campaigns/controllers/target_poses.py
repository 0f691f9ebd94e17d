"""Files of target poses: wanted ones in, wanted and commanded ones out."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from campaigns.arrays import Array
from campaigns.controllers.corrected_targets import CorrectedFile, TargetCorrection, correction_mm
from campaigns.errors import TargetsInvalid
from campaigns.files.csv_file import CsvColumn, CsvForm, csv_text, number_text, parse_csv
from campaigns.kinematics.axes import Axis
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.shots.columns import axis_columns, axis_texts, columns_of

NAME = "name"
COMMANDED_DECIMALS = 6


TargetPoses: TypeAlias = tuple[tuple[str, ...], tuple[str, ...], Array]
"""Wanted poses of a file: names, empty where it gives none, file and line of each, and (N, t)."""


def parse_poses(text: str, name: str, mechanism: ClosedChain) -> TargetPoses:
    """Poses of a file's text; raises `TargetsInvalid` naming the line."""
    form = CsvForm((*columns_of(mechanism.task), CsvColumn(NAME)), TargetsInvalid)
    rows = list(parse_csv(text, name, form))
    if not rows:
        raise TargetsInvalid(f"{name}: holds no poses", remedy="give a row for each pose")
    return (
        tuple(row.text(NAME) for row in rows),
        tuple(row.where for row in rows),
        np.array([row.values(axis_columns(mechanism.task)) for row in rows]),
    )


def correct_poses(text: str, name: str, correction: TargetCorrection) -> CorrectedFile:
    """Text of wanted poses and what to command for each, one after another.

    Joints turn round at targets only. Raises `TargetsInvalid` naming the first line that is wrong
    or cannot be taken.
    """
    mechanism = correction.identified.mechanism
    names, places, wanted = parse_poses(text, name, mechanism)

    def place(row: int) -> str:
        return f"{places[row]}: {names[row]}" if names[row] else places[row]

    correction.require_possible(wanted, place)
    commanded = correction.commanded(wanted, correction.approach(wanted)).values_or_raise()
    size_mm, std_mm = correction_mm(wanted, commanded), correction.std_mm(wanted)
    sizes = size_mm, std_mm
    text = corrected_text(mechanism.task, names, wanted, commanded, sizes)
    return CorrectedFile.of(text, *sizes)


def corrected_columns(task: tuple[Axis, ...]) -> tuple[str, ...]:
    """Columns of the file that is written."""
    columns = axis_columns(task)
    turns = tuple(f"correction_{axis.column}" for axis in task if axis.is_revolute)
    commanded = tuple(f"commanded_{column}" for column in columns)
    return (NAME, *columns, *commanded, "correction_mm", *turns, "position_std_mm")


def corrected_text(
    task: tuple[Axis, ...],
    names: Sequence[str],
    wanted: Array,
    commanded: Array,
    sizes: tuple[Array, Array],
) -> str:
    """Text of the file: poses (N, t) wanted and commanded, `sizes` of corrections, and their σ."""
    turns = [column for column, axis in enumerate(task) if axis.is_revolute]
    size_mm, std_mm = sizes
    told = np.column_stack([size_mm, np.degrees(commanded - wanted)[:, turns], std_mm])
    rows = zip(names, wanted.tolist(), commanded.tolist(), told.tolist(), strict=True)
    return csv_text(
        corrected_columns(task),
        [
            [
                name,
                *axis_texts(task, own),
                *(_rounded(axis.to_file(v)) for axis, v in zip(task, other, strict=True)),
                *map(_rounded, each),
            ]
            for name, own, other, each in rows
        ],
    )


def _rounded(value: float) -> str:
    return "" if np.isnan(value) else number_text(round(value, COMMANDED_DECIMALS))
