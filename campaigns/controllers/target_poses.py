"""Files of target poses: wanted ones in, wanted and commanded ones out."""

from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

import numpy as np

from campaigns.arrays import Array
from campaigns.controllers.corrected_targets import TargetCorrection, correction_mm
from campaigns.errors import TargetsInvalid
from campaigns.files.csv_file import CsvForm, csv_text, number_text, parse_csv
from campaigns.files.text_file import read_text
from campaigns.mechanisms.closed_chain import ClosedChain
from campaigns.mechanisms.mechanism import Axis
from campaigns.shots.columns import axis_columns, axis_texts, axis_values
from drivers.bounded_files import CSV_BYTES

NAME = "name"
COMMANDED_DECIMALS = 6


TargetPoses: TypeAlias = tuple[tuple[str, ...], tuple[str, ...], Array]
"""Wanted poses of a file: names, empty where it gives none, file and line of each, and (N, t)."""


@dataclass(frozen=True, slots=True, eq=False)
class CorrectedPoses:
    """Targets with what to command for them."""

    names: tuple[str, ...]
    wanted: Array
    """(N, t)"""
    commanded: Array
    """(N, t)"""
    std_mm: Array
    """1 σ of the position, (N,); NaN where it is not known."""

    @property
    def correction_mm(self) -> Array:
        """Size of each correction of a position, (N,)."""
        return correction_mm(self.wanted, self.commanded)


def read_poses(path: Path, mechanism: ClosedChain) -> TargetPoses:
    """Poses of a CSV file; raises `TargetsInvalid` naming the line."""
    text = read_text(path, TargetsInvalid, if_missing="name a CSV file", most_bytes=CSV_BYTES)
    return parse_poses(text, str(path), mechanism)


def parse_poses(text: str, name: str, mechanism: ClosedChain) -> TargetPoses:
    """Poses of a file's text; raises `TargetsInvalid` naming the line."""
    form = CsvForm(axis_columns(mechanism.task), (NAME,), TargetsInvalid)
    rows = list(parse_csv(text, name, form))
    if not rows:
        raise TargetsInvalid(f"{name}: holds no poses", remedy="give a row for each pose")
    return (
        tuple(row.text(NAME) for row in rows),
        tuple(row.where for row in rows),
        np.array([axis_values(row, mechanism.task) for row in rows]),
    )


def correct_poses(targets: TargetPoses, correction: TargetCorrection) -> CorrectedPoses:
    """What to command for each, one after another, joints turning round at targets only.

    Raises `TargetsInvalid` for the first that cannot be taken.
    """
    names, places, wanted = targets
    fault = correction.first_fault(wanted)
    if fault is not None:
        row, reason = fault
        name = names[row]
        raise TargetsInvalid(
            f"{places[row]}: {f'{name}: ' if name else ''}{reason}",
            remedy="change the pose, or widen the calibrated workspace with --margin and "
            "--turn-margin",
        )
    sides = correction.approach(wanted)
    commanded = correction.commanded(wanted, sides).values_or_raise()
    return CorrectedPoses(names, wanted, commanded, correction.std_mm(wanted))


def corrected_columns(task: tuple[Axis, ...]) -> tuple[str, ...]:
    """Columns of the file that is written."""
    columns = axis_columns(task)
    turns = tuple(f"correction_{axis.column}" for axis in task if axis.is_revolute)
    commanded = tuple(f"commanded_{column}" for column in columns)
    return (NAME, *columns, *commanded, "correction_mm", *turns, "position_std_mm")


def corrected_text(found: CorrectedPoses, task: tuple[Axis, ...]) -> str:
    """Text of the file: wanted, commanded, the correction's size, and σ of the position."""
    turns = [column for column, axis in enumerate(task) if axis.is_revolute]
    turned = np.degrees(found.commanded - found.wanted)[:, turns]
    rows = zip(
        found.names,
        found.wanted.tolist(),
        found.commanded.tolist(),
        np.column_stack([found.correction_mm, turned, found.std_mm]).tolist(),
        strict=True,
    )
    return csv_text(
        corrected_columns(task),
        [
            [
                name,
                *axis_texts(task, wanted),
                *(_rounded(axis.to_file(v)) for axis, v in zip(task, commanded, strict=True)),
                *map(_rounded, sizes),
            ]
            for name, wanted, commanded, sizes in rows
        ],
    )


def _rounded(value: float) -> str:
    return "" if np.isnan(value) else number_text(round(value, COMMANDED_DECIMALS))
