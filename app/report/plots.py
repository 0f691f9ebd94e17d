"""Single figures as files, for `plan --plot` and `identify --plot`."""

from collections.abc import Sequence
from pathlib import Path

from app.report.figures.distances import pair_errors
from app.report.figures.drawing import save
from app.report.figures.plan import plan_picture
from app.report.groups import error_group
from campaigns.design.restricted_space import UNRESTRICTED, RestrictedSpace
from campaigns.identification.result import IdentificationResult
from campaigns.planning.forecast import Forecast
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import poses_of


def plot_plan(
    path: Path,
    shots: Sequence[PlannedShot],
    forecast: Forecast,
    space: RestrictedSpace = UNRESTRICTED,
) -> None:
    """Draw a plan and its predicted uncertainty; .svg, .png or .pdf. Raise `WriteFailed`."""
    purposes = tuple(shot.purpose for shot in shots)
    save(plan_picture(poses_of(shots), purposes, forecast, space), path)


def plot_residuals(path: Path, found: IdentificationResult) -> None:
    """Draw what was fitted and the hold-out pairs, before and after; raise `WriteFailed`."""
    distances = found.fitted is not None and found.fitted.of == "pairs"
    fitted = "fitted pairs" if distances else "fitted shots, length of the error"
    tables = ((fitted, "o", found.fitted), ("hold-out pairs, error of distance", "D", found.unseen))
    groups = [
        error_group(name, marker, table.before, table.after)
        for name, marker, table in tables
        if table is not None
    ]
    quantity, what = ("error of distance", "pairs") if distances else ("error", "shots and pairs")
    save(pair_errors(groups, quantity=quantity, what=what), path)
