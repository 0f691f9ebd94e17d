"""pkmcal history: parameters and errors over campaigns, and when the next check is due."""

from collections.abc import Sequence
from dataclasses import asdict
from datetime import datetime
from pathlib import Path
from typing import Annotated

import typer

from app.console import BAD, OPEN, terminal_of
from app.options import Json, Plot
from app.report.figures import drawing
from app.report.figures.history import over_campaigns
from campaigns.campaign import now_utc, open_campaign
from campaigns.estimation.information import WeightedLine
from campaigns.evaluation.trend import Change, Epoch, ParameterTrend
from campaigns.evaluation.validation import MeasuredLength
from campaigns.files.table import Column, csv_table, words
from campaigns.files.text_file import replace_text
from campaigns.workflow.history import history

PER_DAYS = 30.0
Folders = Annotated[
    list[Path], typer.Argument(metavar="DIR…", help="Campaigns of one robot.", show_default=False)
]
CsvFile = Annotated[
    Path | None, typer.Option("--csv", metavar="FILE", help="Also write all values as CSV.")
]
CHANGES: tuple[Column[Change], ...] = (
    words("parameter", lambda row: row.name),
    Column("no.", lambda row: row.epoch),
    Column("value", lambda row: row.value, decimals=4),
    Column("σ", lambda row: row.std, decimals=4),
    Column("Δ", lambda row: row.delta, decimals=4, signed=True),
    Column("Δ/σ", lambda row: row.ratio, decimals=1, signed=True),
    words("unit", lambda row: row.unit),
)
ALL: tuple[Column[Change], ...] = (*CHANGES, words("measured_utc", lambda row: row.measured_utc))
RATES: tuple[Column[ParameterTrend], ...] = (
    words("parameter", lambda row: row.name),
    Column("in 30 days", lambda row: _monthly(row.line, "rate"), decimals=4, signed=True),
    Column("σ", lambda row: _monthly(row.line, "rate_std"), decimals=4),
    words("unit", lambda row: row.changes[0].unit),
    words("", lambda row: "drifts" if row.drifts else "not steadily" if row.jumps else "no trend"),
)
Numbered = tuple[int, Epoch]
EPOCHS: tuple[Column[Numbered], ...] = (
    Column("no.", lambda row: row[0]),
    words("folder", lambda row: row[1].folder),
    words("what", lambda row: row[1].kind),
    words("measured", lambda row: row[1].measured_utc[:10]),
    Column("before", lambda row: _mm(row[1].before)),
    Column("after", lambda row: _mm(row[1].after)),
    Column("hold-out", lambda row: row[1].unseen_mm),
    words("verdict", lambda row: row[1].decision),
)


def command(
    context: typer.Context,
    folders: Folders,
    *,
    plot: Plot = None,
    csv: CsvFile = None,
    json: Json = False,
) -> None:
    """Show parameters and errors over campaigns, and when the next check is due.

    Takes campaigns of one robot with their checks and repairs, in the order of time. The table
    shows the parameters whose values spread by more than their σ; --json and --csv have all. If a
    parameter drifts beyond chance, along a line through three days or more, the next check is due
    when the drift plus 2 σ would use up acceptance.distance_mean_mm of the latest campaign, or,
    without that limit, double U of positions. Nests with equal names in two campaigns show how the
    base moved between them, with U, separately from changes of the robot.
    """
    terminal = terminal_of(context, as_json=json)
    campaigns = [open_campaign(folder) for folder in folders]
    found = history(campaigns, datetime.fromisoformat(now_utc()))
    title = "Campaigns and checks, mean errors of distances in mm"
    terminal.rows(title, EPOCHS, enumerate(found.epochs, start=1))
    for number, epoch in enumerate(found.epochs, start=1):
        if epoch.says:  # too long for a column
            terminal.say(f"{number}: {epoch.says}")
    moved = [each for each in found.trends if each.moves]
    if moved:
        terminal.rows("Parameters that changed", CHANGES, _changes(moved))
    if rated := [each for each in moved if each.line]:
        terminal.rows("Trends", RATES, rated)
    for each in found.bases:
        terminal.say(each.says, OPEN if each.base.decision != "pass" else "")
    for note in found.notes:
        terminal.note(note)
    terminal.say(found.due.says, BAD if found.due.drifting else "")
    if csv is not None:
        replace_text(csv, csv_table(ALL, _changes(found.trends)))
        terminal.say(f"written: {csv}")
    if plot is not None:
        drawing.save(over_campaigns(found.epochs, moved), plot)
        terminal.say(f"drawn: {plot}")
    parameters = {each.name: asdict(each) | {"drifts": each.drifts} for each in found.trends}
    epochs = [asdict(each) for each in found.epochs]
    bases = [asdict(each) | {"says": each.says} for each in found.bases]
    document = {"epochs": epochs, "parameters": parameters, "notes": found.notes, "bases": bases}
    terminal.document(document | {"next_check": asdict(found.due)})


def _changes(every: Sequence[ParameterTrend]) -> list[Change]:
    return [change for each in every for change in each.changes]


def _mm(length: MeasuredLength | None) -> float | None:
    return None if length is None else length.value_mm


def _monthly(line: WeightedLine | None, of: str) -> float | None:
    return None if line is None else PER_DAYS * float(getattr(line, of))
