"""Errors as groups of marks; single figures as files, for `plan --plot` and `identify --plot`."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from app.report.figures.distances import PairGroup, pair_errors
from app.report.figures.drawing import save
from app.report.figures.plan import plan_picture
from campaigns.arrays import Array
from campaigns.design.restricted_space import UNRESTRICTED, RestrictedSpace
from campaigns.estimation.estimators import Estimator
from campaigns.evaluation.model_errors import ShotErrors
from campaigns.evidence import Evaluation
from campaigns.identification.result import IdentificationResult
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import poses_of
from campaigns.planning.predicted_precision import PrecisionCurvePoint, PredictedPrecision


def shot_group(shots: ShotErrors) -> PairGroup:
    """Lengths of the errors of fitted shots."""
    return _group("fitted shots", "o", shots.before_mm, shots.after_mm)


def pair_groups(found: Evaluation) -> tuple[PairGroup, ...]:
    """Fitted and unseen pairs by the models, and the pairs that the controller was told."""
    errors, stages = found.errors, (found.before, found.after)
    modelled = (
        ("fitted pairs", "o", errors.fitted if errors else None),
        ("unseen pairs", "D", errors.unseen if errors else None),
    )
    groups = [
        PairGroup(name, marker, pairs.before_mm, pairs.after_mm)
        for name, marker, pairs in modelled
        if pairs is not None
    ]
    tests = [stage.distances if stage else None for stage in stages]
    if any(tests):
        told = (test.errors_mm if test else None for test in tests)
        groups.append(PairGroup("commanded pairs", "s", *told))
    return tuple(groups)


def plot_plan(
    path: Path,
    shots: Sequence[PlannedShot],
    predicted: PredictedPrecision,
    curve: Sequence[PrecisionCurvePoint],
    space: RestrictedSpace = UNRESTRICTED,
) -> None:
    """Draw a plan and what it will tell; .svg, .png or .pdf. Raises `WriteFailed`."""
    purposes = tuple(shot.purpose for shot in shots)
    save(plan_picture(poses_of(shots), purposes, predicted, curve, space), path)


def plot_residuals(path: Path, found: IdentificationResult) -> None:
    """Draw what was fitted and the unseen pairs, before and after; raises `WriteFailed`."""
    distances = found.estimator is Estimator.DISTANCES
    fitted = "fitted pairs" if distances else "fitted shots, length of the error"
    tables = ((fitted, "o", found.fitted), ("unseen pairs, error of distance", "D", found.unseen))
    groups = [
        _group(name, marker, table.before, table.after)
        for name, marker, table in tables
        if table is not None
    ]
    quantity, what = ("error of distance", "pairs") if distances else ("error", "shots and pairs")
    save(pair_errors(groups, quantity=quantity, what=what), path)


def _group(name: str, marker: str, *errors: Array) -> PairGroup:
    """Group of distances (N, 1) with their sign, or of positions (N, 3) by their length."""
    before, after = (
        each[:, 0] if each.shape[1] == 1 else np.linalg.norm(each, axis=1) for each in errors
    )
    return PairGroup(name, marker, before, after)
