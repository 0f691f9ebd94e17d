"""pkmcal new: a campaign's folder."""

import typer

from app.console import terminal_of
from app.new_campaign import NewOptions, create_campaign
from app.next import tell_next
from app.options import Json, NewFolder
from campaigns.campaign import open_campaign
from campaigns.settings.sections import OFFLINE


def command(
    context: typer.Context, folder: NewFolder, options: NewOptions, *, json: Json = False
) -> None:
    """Make a campaign's folder: settings and nominal robot.

    campaign.yaml explains each of its keys. With --controller and --tracker the campaign is for a
    real cell, otherwise for a simulated one, whose errors are listed in cell.yaml.

    One of them may be sim://SCENARIO, to rehearse with the other: the simulated tracker then
    measures a robot that stands at the real controller's joints. A device may be by-hand, and a
    tracker file:NAME.

    With --offline no device is ever connected: the robot's own controller and the tracker's own
    software measure, and `pkmcal import` reads their files.

    pkmcal new first-try

    pkmcal new cell-3 --controller tcp://192.168.0.10:5020 --tracker tcp://192.168.0.1:700

    pkmcal new cell-5 --offline
    """
    terminal = terminal_of(context, as_json=json)
    config = create_campaign(folder, options)
    urls = {"controller": config.controller.url, "tracker": config.tracker.url}
    devices = OFFLINE if options.offline else f"with {urls['controller']} and {urls['tracker']}"
    terminal.say(f"made: {folder}, {devices}")
    following = tell_next(terminal, open_campaign(folder))
    terminal.document({"folder": str(folder), **urls} | following)
