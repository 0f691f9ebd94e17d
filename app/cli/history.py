"""pkmcal history: show how parameters and errors of a robot change over its campaigns."""

from pathlib import Path
from typing import Annotated

import typer

from app.console import Terminal
from campaigns.files.table import NOTHING, Column, csv_table, words
from campaigns.files.text_file import replace_text
from campaigns.workflow.history import Epoch, ParameterError, history, readable_campaign

Folders = Annotated[
    list[Path], typer.Argument(metavar="DIR…", help="Campaigns of one robot.", show_default=False)
]
CsvFile = Annotated[
    Path | None, typer.Option("--csv", metavar="FILE", help="Also write all parameters as CSV.")
]
ERRORS: tuple[Column[ParameterError], ...] = (
    words("parameter", lambda row: row.name),
    words("measured", lambda row: row.measured_utc[:10]),
    Column("Δ", lambda row: row.delta, decimals=4, signed=True),
    Column("σ", lambda row: row.std, decimals=4),
    words("unit", lambda row: row.unit),
)
MODEL: Column[ParameterError] = words(
    "model", lambda row: "older" if row.by_older_model else "this version's"
)
"""Column that is shown only if an older version identified any of the parameters."""
Numbered = tuple[int, Epoch]
"""Epoch with its number in the table, by which the lines below the table refer to it."""
EPOCHS: tuple[Column[Numbered], ...] = (
    Column("no.", lambda row: row[0]),
    words("folder", lambda row: row[1].folder),
    words("what", lambda row: row[1].kind),
    words("measured", lambda row: row[1].measured_utc[:10]),
    Column("before", lambda row: row[1].before_mm),
    Column("after", lambda row: row[1].after_mm),
    Column("hold-out", lambda row: row[1].unseen_mm),
    words("verdict", lambda row: row[1].decision or NOTHING),
)


def command(terminal: Terminal, folders: Folders, *, csv: CsvFile = None) -> None:
    """Show parameters and errors over campaigns.

    Takes campaigns of one robot with their checks, in the order of time. The table of parameters
    has the difference Δ from the nominal value with its σ for each identification that passed.
    """
    epochs = history([readable_campaign(folder) for folder in folders])
    title = "Campaigns and checks, mean errors of distances in mm"
    terminal.rows(title, EPOCHS, enumerate(epochs, start=1))
    for number, epoch in enumerate(epochs, start=1):
        for text in filter(None, (epoch.says, epoch.note)):  # too long for a column
            terminal.say(f"{number}: {text}")
    # by parameter first, then by date, so that the course of each parameter can be read downwards
    names = dict.fromkeys(error.name for epoch in epochs for error in epoch.parameters)
    errors = [e for name in names for epoch in epochs for e in epoch.parameters if e.name == name]
    columns = (*ERRORS, MODEL) if any(error.by_older_model for error in errors) else ERRORS
    terminal.rows("Parameters: identified minus nominal", columns, errors)
    if csv is not None:
        replace_text(csv, csv_table(columns, errors))
        terminal.say(f"written: {csv}")
    terminal.conclude({"epochs": epochs})
