"""pkmcal import: shots measured with other software."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.options import Folder, Json

if TYPE_CHECKING:
    from app.folder import Campaign


def command(
    folder: Folder,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="shots.csv (docs/files.md).")],
    *,
    json: Json = False,
) -> None:
    """Take shots measured elsewhere into the campaign: two rows of one pair number are a pair.

    Rows with set "validation" are kept unseen by the fit.
    """
    from app.console import Terminal
    from app.folder import open_campaign

    terminal = Terminal(as_json=json)
    series, shots = import_shots(open_campaign(folder), file)
    terminal.say(f"{shots} shots taken in as series {series}")
    terminal.document({"series": series, "shots": shots})
    terminal.note(f"next: pkmcal identify {folder}")


def import_shots(campaign: "Campaign", file: Path) -> tuple[int, int]:
    """Write a file's shots into the journal as a series; gives its number and how many shots."""
    from app.folder import journal_of
    from campaigns.exchange import read_shots
    from campaigns.importing import append_import
    from campaigns.planning import numeric_geometry

    rows = read_shots(file)
    with journal_of(campaign) as journal:
        robot = campaign.nominal.robot
        settings = campaign.config.model_dump(mode="json")
        series = append_import(journal, rows, numeric_geometry(robot), robot.digest(), settings)
    return series, len(rows)
