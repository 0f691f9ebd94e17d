"""pkmcal correct: targets for a controller that takes no parameters."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from app.console import Terminal
from app.next import tell_next
from app.options import Excel, Force, Turns, ask_turns, for_spreadsheets
from campaigns.campaign import Campaign
from campaigns.controllers.export import FILE_NAME
from campaigns.workflow.correction import correct_file
from drivers.texts import quoted

CORRECTED = "-corrected"
"""End of the name of a file of corrected poses."""

Poses = Annotated[
    Path,
    typer.Option(
        metavar="FILE",
        help="Wanted poses: a CSV with a column for each coordinate, such as x_mm; name optional.",
    ),
]
Robot = Annotated[
    Path | None,
    typer.Option(
        metavar="FILE", help="The identified set. Default, in DIR: robot-compensated.yaml."
    ),
]
To = Annotated[
    Path | None, typer.Option(metavar="FILE", help=f"Default: beside the file, NAME{CORRECTED}.")
]


@dataclass(frozen=True, slots=True, kw_only=True)
class CorrectAnswer:
    """Answer of `correct`: file of corrected poses, and the size of the corrections."""

    path: Path
    poses: int
    correction_mm: Mapping[str, float]
    position_std_mm: float | None


def command(
    terminal: Terminal,
    campaign: Campaign,
    *,
    robot: Robot = None,
    poses: Poses,
    turns: Turns = None,
    to: To = None,
    excel: Excel = False,
    force: Force = False,
) -> None:
    """Correct targets for a controller that keeps its nominal parameters.

    For each wanted pose: the pose to command, so that the robot stands where it would with the
    identified parameters loaded. A line is refused if its pose is out of reach or not allowed.

    pkmcal correct cell-3 --poses poses.csv
    pkmcal correct cell-3 --poses poses.csv --robot found.yaml --to commands.csv
    """
    path = to or poses.parent / f"{poses.stem}{CORRECTED}{poses.suffix}"
    turns = ask_turns(terminal, turns, poses, campaign.robot.mechanism.task)
    corrected = correct_file(campaign, poses, path, robot, turns=turns, overwrite=force)
    for_spreadsheets(path, excel=excel)
    mean_mm, max_mm = corrected.correction_mm
    terminal.say(f"written: {path}")
    poses_word = "pose" if corrected.targets == 1 else "poses"
    terminal.say(
        f"{corrected.targets} {poses_word}, corrected by {mean_mm:.3f} mm on average, "
        f"{max_mm:.3f} mm at most{_sigma(corrected.std_mm, campaign, robot)}"
    )
    answer = CorrectAnswer(
        path=path,
        poses=corrected.targets,
        correction_mm={"mean": mean_mm, "max": max_mm},
        position_std_mm=corrected.std_mm,
    )
    terminal.conclude(answer, tell_next(terminal, campaign))


def _sigma(std_mm: float | None, campaign: Campaign, robot: Path | None) -> str:
    """Return the uncertainty in words, or why it is unknown and how to get it."""
    # A set has its covariance in the journal, found by the set's digest. A file that somebody has
    # edited, or the set of another campaign, is in no journal of this one.
    if std_mm is not None:
        return f"; 1 σ of the position {std_mm:.3f} mm at most"
    file = robot.name if robot else FILE_NAME
    folder = quoted(str(campaign.folder))
    again = f"`pkmcal correct {folder}`"
    again += " without --robot takes it" if robot else " again"
    return (
        f"; its uncertainty is unknown: {file} holds no set that an identification in the journal "
        f"found → `pkmcal export {folder} --force` writes such a {FILE_NAME}, {again}"
    )
