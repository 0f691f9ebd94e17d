"""pkmcal correct: targets for a controller that takes no parameters."""

from pathlib import Path
from typing import Annotated

import typer

from app.console import terminal_of
from app.next import tell_next
from app.options import Folder, Json, Overwrite
from campaigns.campaign import Campaign, open_campaign
from campaigns.controllers.export import FILE_NAME
from campaigns.settings.option import Option
from campaigns.workflow.correction import correct_file

WORD = "-corrected"

Poses = Annotated[
    Path,
    Option("CSV with a column for each coordinate, such as x_mm; name may be left out.", "FILE"),
]
Robot = Annotated[
    Path | None,
    Option("The identified set. Default, in DIR: robot-compensated.yaml.", metavar="FILE"),
]
To = Annotated[Path | None, Option(f"Default: beside the file, NAME{WORD}.", metavar="FILE")]


def command(
    context: typer.Context,
    folder: Folder,
    *,
    robot: Robot = None,
    poses: Poses,
    to: To = None,
    overwrite: Overwrite = False,
    json: Json = False,
) -> None:
    """Correct targets for a controller that keeps its nominal parameters.

    For each wanted pose: the pose to command, so that the robot stands where it would with the
    identified parameters loaded. A line is refused if its pose is out of reach or not allowed.
    """
    terminal = terminal_of(context, as_json=json)
    campaign = open_campaign(folder)
    path = to or poses.parent / f"{poses.stem}{WORD}{poses.suffix}"
    found = correct_file(campaign, poses, path, robot, overwrite=overwrite)
    (mean_mm, max_mm), std_mm = found.correction_mm, found.std_mm
    terminal.say(f"written: {path}")
    terminal.say(
        f"{found.targets} poses, corrected by {mean_mm:.3f} mm on average, {max_mm:.3f} mm at most"
        f"{_sigma(std_mm, campaign, robot)}"
    )
    size_mm = {"mean": mean_mm, "max": max_mm}
    document = {
        "path": path,
        "poses": found.targets,
        "correction_mm": size_mm,
        "position_std_mm": std_mm,
    }
    terminal.document(document | tell_next(terminal, campaign))


def _sigma(std_mm: float | None, campaign: Campaign, robot: Path | None) -> str:
    if std_mm is not None:
        return f"; 1 σ of the position {std_mm:.3f} mm at most"
    file = robot.name if robot else FILE_NAME
    again = f"`pkmcal correct {campaign.folder}`"
    again += " without --robot takes it" if robot else " again"
    return (
        f"; its uncertainty is unknown: {file} holds no set that an identification in the journal "
        f"found → `pkmcal export {campaign.folder} --overwrite` writes such a {FILE_NAME}, {again}"
    )
