"""pkmcal import: shots measured with other software."""

from dataclasses import dataclass
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from app.options import Folder, Json

if TYPE_CHECKING:
    from collections.abc import Sequence

    from app.folder import Campaign
    from campaigns.shots.ascii_points import LengthUnit
    from campaigns.shots.shots_csv import ShotRow


class Form(Enum):
    """Kinds of files; the value is the word on the command line."""

    SHOTS = "shots"
    ASCII = "ascii"


@dataclass(frozen=True, slots=True)
class Source:
    """What is to be read, and how."""

    file: Path
    form: Form = Form.SHOTS
    unit: "LengthUnit | None" = None
    joints: Path | None = None
    join: Literal["name", "order"] = "name"
    columns: str | None = None


def command(
    context: typer.Context,
    folder: Folder,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="A shots.csv, see above.")],
    *,
    form: Annotated[
        Form, typer.Option("--format", help="shots: as above; ascii: points of other software.")
    ] = Form.SHOTS,
    unit: Annotated[
        Literal["mm", "m", "inch"] | None,
        typer.Option(help="Of an ascii file's lengths; it does not say itself."),
    ] = None,
    joints: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="For ascii: name,q0_deg…q3_deg,pair,set of each point."),
    ] = None,
    join: Annotated[
        Literal["name", "order"],
        typer.Option(help="For ascii: how points and joints belong together."),
    ] = "name",
    columns: Annotated[
        str | None, typer.Option(metavar="NAMES", help="For ascii: such as name,x,y,z.")
    ] = None,
    json: Json = False,
) -> None:
    """Take in shots measured with other software.

    A CSV file with one row a shot: encoder angles, and the reflector's place in the tracker's
    frame. Two rows with one pair number are a pair. The header is

    pair,q0_deg,q1_deg,q2_deg,q3_deg,x_mm,y_mm,z_mm

    and may go on with set, theta_deg, sxx, sxy, sxz, syy, syz, szz (mm²), temperature_degC, time.
    Pairs of the set "validation" stay unseen by the fit and prove it; "identification" is the
    default.

    With --format ascii: a point export of SpatialAnalyzer or OpenIndy, its --unit, and a file with
    the --joints of each point.
    """
    from app.console import terminal_of
    from app.folder import open_campaign

    terminal = terminal_of(context, as_json=json)
    source = Source(file, form, unit, joints, join, columns)
    rows, notes = read_source(source)
    for note in notes:
        terminal.note(note)
    series, shots = import_shots(open_campaign(folder), rows)
    terminal.say(f"taken in: {shots} shots, as series {series}")
    terminal.note(f"next: pkmcal identify {folder}")
    terminal.document({"series": series, "shots": shots})


def read_source(source: Source) -> "tuple[tuple[ShotRow, ...], tuple[str, ...]]":
    """The shots of a file, and what should be known about how it was read."""
    from campaigns.shots.shots_csv import read_shots

    if source.form is Form.SHOTS:
        if source.unit or source.joints or source.columns:
            raise typer.BadParameter("--unit, --joints and --columns go with --format ascii")
        return read_shots(source.file), ()
    if source.joints is None:
        raise typer.BadParameter("--format ascii needs --joints FILE with each point's joints")
    from campaigns.shots.joined_shots import PointSource, read_joined_shots

    columns = tuple(source.columns.split(",")) if source.columns else None
    points = PointSource(source.file, source.unit, columns)
    joined = read_joined_shots(points, source.joints, join=source.join)
    return joined.rows, joined.notes


def import_shots(campaign: "Campaign", rows: "Sequence[ShotRow]") -> tuple[int, int]:
    """Write shots into the journal as a series; gives its number and how many shots."""
    from app.folder import journal_of
    from campaigns.robots.robot import numeric_geometry
    from campaigns.shots.import_export import append_import

    with journal_of(campaign) as journal:
        robot = campaign.nominal.robot
        settings = campaign.config.model_dump(mode="json")
        series = append_import(journal, rows, numeric_geometry(robot), robot.digest(), settings)
    return series, len(rows)
