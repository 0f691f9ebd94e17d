"""pkmcal history: show how parameters and errors of a robot change over its campaigns."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from app.console import Terminal
from app.options import Excel, for_spreadsheets
from campaigns.errors import OptionsInvalid
from campaigns.files.csv_file import csv_text, number_text
from campaigns.files.table import NOTHING, Column, words
from campaigns.files.text_file import replace_text
from campaigns.workflow.history import Epoch, ParameterError, history, readable_campaign

Folders = Annotated[
    list[Path], typer.Argument(metavar="DIR…", help="Campaigns of one robot.", show_default=False)
]
CsvFile = Annotated[
    Path | None, typer.Option("--csv", metavar="FILE", help="Also write all parameters as CSV.")
]
Named = tuple[int, ParameterError]
"""Error of a parameter with the number of its epoch."""
ERRORS: tuple[Column[Named], ...] = (
    words("parameter", lambda row: row[1].name),
    Column("no.", lambda row: row[0]),
    words("measured", lambda row: row[1].measured_utc[:10]),
    Column("Δ", lambda row: row[1].delta, decimals=4, signed=True),
    Column("σ", lambda row: row[1].std, decimals=4),
    words("unit", lambda row: row[1].unit),
)
MODEL: Column[Named] = words(
    "model", lambda row: "older" if row[1].by_older_model else "this version's"
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


def command(
    terminal: Terminal, folders: Folders, *, csv: CsvFile = None, excel: Excel = False
) -> None:
    """Show parameters and errors over campaigns.

    Takes campaigns of one robot with their checks, in the order of time. The table of parameters
    has the difference Δ from the nominal value with its σ for each identification that passed; as
    CSV it has a row for each parameter, and two columns for each identification.
    """
    if excel and csv is None:
        raise OptionsInvalid("--excel is for a CSV file", remedy="add --csv FILE, or leave it out")
    epochs = history([readable_campaign(folder) for folder in folders])
    title = "Campaigns and checks, mean errors of distances in mm"
    terminal.rows(title, EPOCHS, enumerate(epochs, start=1))
    for number, epoch in enumerate(epochs, start=1):
        for text in filter(None, (epoch.says, epoch.note)):  # too long for a column
            terminal.say(f"{number}: {text}")
    # by parameter first, then by date, so that the course of each parameter can be read downwards
    names = dict.fromkeys(error.name for epoch in epochs for error in epoch.parameters)
    errors = [
        (number, error)
        for name in names
        for number, epoch in enumerate(epochs, start=1)
        for error in epoch.parameters
        if error.name == name
    ]
    columns = (*ERRORS, MODEL) if any(error.by_older_model for _, error in errors) else ERRORS
    terminal.rows("Parameters: identified minus nominal", columns, errors)
    if csv is not None:
        replace_text(csv, parameters_csv(epochs, list(names)))
        for_spreadsheets(csv, excel=excel)
        terminal.say(f"written: {csv}")
    terminal.conclude({"epochs": epochs})


def parameters_csv(epochs: Sequence[Epoch], names: Sequence[str]) -> str:
    """Write the errors of parameters by name, and σ of each, in columns for each epoch."""
    identified = [epoch for epoch in epochs if epoch.parameters]
    heads, rows = ["parameter", "unit"], {name: [name, ""] for name in names}
    for epoch in identified:
        model = " (older model)" if epoch.by_older_model else ""
        title = f"{epoch.folder} {epoch.measured_utc[:10]}{model}"
        heads += [f"{title} delta", f"{title} std"]
        errors = {error.name: error for error in epoch.parameters}
        for name, row in rows.items():
            error = errors.get(name)
            row[1] = error.unit if error else row[1]
            row += [number_text(error.delta), number_text(error.std)] if error else ["", ""]
    return csv_text(heads, rows.values())
