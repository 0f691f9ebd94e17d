"""pkmcal new: a campaign's folder."""

from dataclasses import dataclass
from pathlib import Path

from app.console import Terminal
from app.new_campaign import NewOptions, create_campaign
from app.next import tell_next
from app.options import NewFolder
from campaigns.campaign import open_campaign
from campaigns.settings.sections import OFFLINE


@dataclass(frozen=True, slots=True)
class NewAnswer:
    """Answer of `new`: the folder, and the addresses of its devices."""

    folder: Path
    controller: str
    tracker: str


def command(terminal: Terminal, folder: NewFolder, options: NewOptions) -> None:
    """Make a campaign's folder: settings and nominal robot.

    campaign.yaml explains each of its keys. With --controller and --tracker the campaign is for a
    real cell, otherwise for a simulated one, whose errors are listed in cell.yaml.

    One of them may be sim://SCENARIO, to rehearse with the other: the simulated tracker then
    measures a robot that stands at the real controller's joints. A device may be by-hand, and a
    tracker file:NAME.

    With --offline no device is ever connected: the robot's own controller and the tracker's own
    software measure, and `pkmcal import` reads their files.

    pkmcal new first-try
    pkmcal new cell-3 --controller tcp://10.0.0.5:5020 --tracker tcp://10.0.0.6:700
    pkmcal new cell-5 --offline
    """
    config = create_campaign(folder, options)
    answer = NewAnswer(folder, config.controller.url, config.tracker.url)
    devices = OFFLINE if options.offline else f"with {answer.controller} and {answer.tracker}"
    terminal.say(f"made: {folder}, {devices}")
    terminal.conclude(answer, tell_next(terminal, open_campaign(folder)))
