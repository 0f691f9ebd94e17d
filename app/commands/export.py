"""pkmcal export: the compensated parameter file."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.options import Folder, Json

if TYPE_CHECKING:
    from app.folder import Campaign


def command(
    folder: Folder,
    *,
    to: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Default: robot-compensated.yaml in DIR.")
    ] = None,
    overwrite: Annotated[
        bool, typer.Option("--overwrite", help="Replace the file if it exists.")
    ] = False,
    json: Json = False,
) -> None:
    """Write the identified parameters as a robot file: values, 1 σ, provenance, digest.

    Only an identification whose verdict is "pass" is exported. The file can be the next campaign's
    nominal robot.
    """
    from app.console import Terminal
    from app.folder import open_campaign

    terminal = Terminal(as_json=json)
    path = export(open_campaign(folder), to, overwrite=overwrite)
    terminal.say(f"written: {path}")
    terminal.document({"path": str(path)})
    terminal.note(f"next: pkmcal load {folder}")


def export(campaign: "Campaign", to: Path | None = None, *, overwrite: bool = False) -> Path:
    """Write the latest identification; raises `VerdictBad`, `OutputExists` or `WriteFailed`."""
    from app.folder import JOURNAL
    from campaigns.errors import ShotsMissing
    from campaigns.export import (
        FILE_NAME,
        compensated_robot,
        latest_identification,
        write_compensated,
    )
    from campaigns.journal_reader import read_journal

    path = to or campaign.path(FILE_NAME)
    journal_path = campaign.path(JOURNAL)
    if not journal_path.exists():
        raise ShotsMissing("nothing has been measured yet", remedy="`pkmcal run` first")
    with read_journal(journal_path) as journal:
        finding = latest_identification(journal)
    robot = compensated_robot(campaign.config.name, campaign.nominal, finding)
    write_compensated(path, robot, overwrite=overwrite)
    return path
