"""Single figures as files, for `plan --plot FILE` and `identify --plot FILE`."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from app.report.figures.distances import PairGroup, pair_errors
from app.report.figures.drawing import save
from app.report.figures.workspace import plan_picture
from campaigns.dataset import Dataset
from campaigns.numerics.forward import forward
from campaigns.numerics.geometry import Array, Geometry
from campaigns.numerics.pairs import distances_mm
from campaigns.plan_file import PlannedShot
from campaigns.planning import poses_of
from campaigns.shot_sets import ShotSet


def plot_plan(path: Path, shots: Sequence[PlannedShot]) -> None:
    """Draw the poses of a plan; .svg, .png or .pdf. Raises `WriteFailed`."""
    save(plan_picture(poses_of(shots), tuple(shot.purpose for shot in shots)), path)


def plot_residuals(path: Path, nominal: Geometry, identified: Geometry, data: Dataset) -> None:
    """Draw the errors of the pairs' distances, before and after; raises `WriteFailed`.

    Pairs at which one of the two cannot be assembled are left out.
    """
    groups = [
        PairGroup(name, marker, *errors)
        for name, marker, purpose in (
            ("fitted pairs", "o", ShotSet.IDENTIFICATION),
            ("unseen pairs", "D", ShotSet.VALIDATION),
        )
        if len((errors := _errors(nominal, identified, data, purpose))[0])
    ]
    save(pair_errors(groups), path)


def _errors(
    nominal: Geometry, identified: Geometry, data: Dataset, purpose: ShotSet
) -> tuple[Array, Array]:
    """Modelled minus measured distances by either model, (M,) each."""
    first, second = data.pair_rows(purpose).T
    measured = distances_mm(data.points_in_tracker_mm, first, second)
    before, after = (
        distances_mm(forward(model, data.joints_rad).values[:, :3], first, second) - measured
        for model in (nominal, identified)
    )
    found = np.isfinite(before) & np.isfinite(after)
    return before[found], after[found]
