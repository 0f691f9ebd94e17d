"""Single figures as files, for `plan --plot FILE` and `identify --plot FILE`."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from app.report.figures.distances import PairGroup, pair_errors
from app.report.figures.drawing import save
from app.report.figures.plan import plan_picture
from campaigns.estimation.estimators import Estimator
from campaigns.identification.result import IdentificationResult, ResidualTable
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import poses_of
from campaigns.planning.predicted_precision import PrecisionCurvePoint, PredictedPrecision


def plot_plan(
    path: Path,
    shots: Sequence[PlannedShot],
    predicted: PredictedPrecision,
    curve: Sequence[PrecisionCurvePoint],
) -> None:
    """Draw a plan and what it will tell; .svg, .png or .pdf. Raises `WriteFailed`."""
    purposes = tuple(shot.purpose for shot in shots)
    save(plan_picture(poses_of(shots), purposes, predicted, curve), path)


def plot_residuals(path: Path, found: IdentificationResult) -> None:
    """Draw what was fitted and the unseen pairs, before and after; raises `WriteFailed`."""
    distances = found.estimator is Estimator.DISTANCES
    fitted = "fitted pairs" if distances else "fitted shots, length of the error"
    tables = {fitted: found.fitted, "unseen pairs, error of distance": found.unseen}
    marks = zip("oD", tables.items(), strict=True)
    groups = [_group(name, mark, each) for mark, (name, each) in marks if each is not None]
    quantity, what = ("error of distance", "pairs") if distances else ("error", "shots and pairs")
    save(pair_errors(groups, quantity=quantity, what=what), path)


def _group(name: str, marker: str, errors: ResidualTable) -> PairGroup:
    """Distances (N, 1) with their sign, positions (N, 3) by their length."""
    before, after = (
        each[:, 0] if each.shape[1] == 1 else np.linalg.norm(each, axis=1)
        for each in (errors.before, errors.after)
    )
    return PairGroup(name, marker, before, after)
