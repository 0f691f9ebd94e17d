"""pkmcal identify: the geometry from the measured shots."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.exits import Exit
from app.options import Fix, Folder, Free, Json, Plot
from campaigns.estimation.estimators import Estimator, LossShape, Model, Outliers

if TYPE_CHECKING:
    from pydantic import JsonValue

    from app.folder import Campaign
    from campaigns.arrays import Array
    from campaigns.identification.result import IdentificationRequest, IdentificationResult
    from campaigns.journal.journal import Journal
    from campaigns.journal.views import Series

WORKSPACE_POSES = 300
"""So many poses stand for the workspace when the position's uncertainty is told."""
WORKSPACE_SEED = 1
BENDS_AT = 3.0

Compared = Annotated[
    Estimator,
    typer.Option(
        help="points: all coordinates of every shot. distances: of pairs, as in the paper."
    ),
]
Extent = Annotated[
    Model,
    typer.Option(
        help="standard: 22 parameters. extended: also where the motors' axes point and what their "
        "gears lose, if unseen pairs speak for it."
    ),
]
Prior = Annotated[
    list[str] | None,
    typer.Option(
        metavar="PATTERN=σ",
        help="Known to lie about nominal with σ (mm, deg), 'arm*.arm_mm=0.05'; repeatable.",
    ),
]
Shape = Annotated[
    LossShape,
    typer.Option(help="How the price of a misfit grows: with its square, or less where it is big."),
]
LossScale = Annotated[
    float,
    typer.Option(min=0.1, max=1000.0, metavar="N", help="Where soft-l1 and cauchy bend, in σ."),
]
LeftOut = Annotated[
    Outliers,
    typer.Option(help="What becomes of shots that all others contradict; each is named."),
]


@dataclass(frozen=True, slots=True)
class IdentifyOptions:
    """What the options say."""

    estimator: Estimator = Estimator.POINTS
    free: tuple[str, ...] = ()
    fix: tuple[str, ...] = ()
    prior: tuple[str, ...] = ()
    loss: LossShape = LossShape.LINEAR
    loss_scale: float = BENDS_AT
    outliers: Outliers = Outliers.EXCLUDE
    model: Model = Model.STANDARD


AS_THE_PAPER = IdentifyOptions(Estimator.DISTANCES, outliers=Outliers.KEEP)
"""Plain least squares of the distances of all pairs."""


def command(
    context: typer.Context,
    folder: Folder,
    *,
    estimator: Compared = Estimator.POINTS,
    model: Extent = Model.STANDARD,
    free: Free = None,
    fix: Fix = None,
    prior: Prior = None,
    loss: Shape = LossShape.LINEAR,
    loss_scale: LossScale = BENDS_AT,
    outliers: LeftOut = Outliers.EXCLUDE,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Find the parameters that explain what was measured.

    Takes the latest run or import. The fit sees the shots of the set "identification" and is
    judged by the pairs of the set "validation", which it never sees. Unless told otherwise it
    finds 22 parameters; the first motor's place, which holds the frame, and the azimuths stay
    nominal. A PATTERN is a parameter's name or a shell's pattern; a whole name outranks it.

    Exit code 1: it was computed, but must not be used; the reasons are given.
    """
    from app.console import terminal_of
    from app.folder import open_campaign
    from app.report.identification_text import show

    terminal = terminal_of(context, as_json=json)
    known = (tuple(free or ()), tuple(fix or ()), tuple(prior or ()))
    asked = IdentifyOptions(estimator, *known, loss, loss_scale, outliers, model)
    found, document = identify(open_campaign(folder), asked)
    terminal.detail(f"estimator: {estimator.value}, {document['seconds']} s")
    show(terminal, found)
    if plot is not None:
        draw(found, plot)
        terminal.say(f"drawn: {plot}")
    terminal.document(document)
    if found.verdict != "pass":
        raise typer.Exit(Exit.NOT_GOOD)
    terminal.note(f"next: pkmcal export {folder}")


def identify(
    campaign: "Campaign", asked: IdentifyOptions
) -> "tuple[IdentificationResult, dict[str, JsonValue]]":
    """Identify from the latest run or import and write the finding into the journal."""
    import time

    from app.folder import journal_of, measured_series, require_journal
    from campaigns.identification.model_selection import candidate_models, select_model
    from campaigns.identification.result import identification_document
    from campaigns.journal.records import Finding
    from campaigns.robots.robot import numeric_geometry
    from campaigns.shots.shots import shots_of_journal

    request = request_of(campaign, asked)
    models = candidate_models(asked.model, asked.free, asked.fix, asked.prior)
    require_journal(campaign)
    with journal_of(campaign) as journal:
        series = measured_series(campaign, journal)
        data = shots_of_journal(journal.shots(series.number))
        nominal = numeric_geometry(campaign.nominal.robot)
        started_s = time.perf_counter()
        found = select_model(nominal, data, request, models)
        document = identification_document(found, time.perf_counter() - started_s)
        provenance = _provenance(campaign, journal, series, len(data.numbers))
        journal.append(Finding("identification", document | provenance))
    return found, document


def request_of(campaign: "Campaign", asked: IdentifyOptions) -> "IdentificationRequest":
    """What the options mean for this campaign, but for what each model leaves to be found."""
    from app.work_builders import tracker_uncertainty_of
    from campaigns.estimation.robust import Loss
    from campaigns.identification.result import IdentificationRequest

    return IdentificationRequest(
        asked.estimator,
        loss=Loss(asked.loss, asked.loss_scale),
        outliers=asked.outliers,
        instrument=tracker_uncertainty_of(campaign.config),
        workspace=_workspace(campaign),
    )


def draw(found: "IdentificationResult", path: Path) -> None:
    """Draw the errors before and after; raises `WriteFailed`."""
    from app.report.plots import plot_residuals

    plot_residuals(path, found)


def _workspace(campaign: "Campaign") -> "Array | None":
    """The same poses all over the robot's reach, seen by the tracker or not; None if it is tiny."""
    import numpy as np

    from app.work_builders import centre_of
    from campaigns.design.pose_sampling import WorkspaceTooSmall, workspace_poses
    from campaigns.robots.robot import numeric_geometry, numeric_limits, pose_row

    robot, centre = campaign.nominal.robot, pose_row(centre_of(campaign))
    geometry, limits = numeric_geometry(robot), numeric_limits(robot)
    rng = np.random.default_rng(WORKSPACE_SEED)
    try:
        return workspace_poses(geometry, limits, centre, WORKSPACE_POSES, rng)
    except WorkspaceTooSmall:
        return None


def _provenance(
    campaign: "Campaign", journal: "Journal", series: "Series", shots: int
) -> "dict[str, JsonValue]":
    from app.folder import now_utc

    return {
        "series": series.number,
        "shots": shots,
        "robot_digest": campaign.nominal.robot.digest(),
        "plan_digest": series.started.plan_digest,
        "journal_digest": journal.digest(),
        "journal_records": journal.last_number(),
        "at_utc": now_utc(),
    }
