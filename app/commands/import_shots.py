"""pkmcal import: shots measured with other software."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.options import Folder, Json

if TYPE_CHECKING:
    from app.folder import Campaign


def command(
    context: typer.Context,
    folder: Folder,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A shots.csv, see above.")],
    *,
    json: Json = False,
) -> None:
    """Take in shots measured with other software.

    A CSV file with one row a shot: encoder angles, and the reflector's place in the tracker's
    frame. Two rows with one pair number are a pair. The header is

    pair,q0_deg,q1_deg,q2_deg,q3_deg,x_mm,y_mm,z_mm

    and may go on with set, theta_deg, sxx, sxy, sxz, syy, syz, szz (mm²), temperature_degC, time.
    Pairs of the set "validation" stay unseen by the fit and prove it; "identification" is the
    default.
    """
    from app.console import terminal_of
    from app.folder import open_campaign

    terminal = terminal_of(context, as_json=json)
    series, shots = import_shots(open_campaign(folder), file)
    terminal.say(f"taken in: {shots} shots, as series {series}")
    terminal.note(f"next: pkmcal identify {folder}")
    terminal.document({"series": series, "shots": shots})


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
