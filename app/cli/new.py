"""pkmcal new: a campaign's folder."""

from typing import Annotated

import typer

from app.console import terminal_of
from app.new_campaign import DEFAULT_ROBOT, DEFAULT_SCENARIO, create_for_devices, create_simulated
from app.next import tell_next
from app.options import Json, NewFolder
from campaigns.campaign import SIMULATED, open_campaign
from campaigns.errors import OptionsInvalid
from campaigns.settings.sections import OFFLINE
from drivers.catalog import CONTROLLERS, TRACKERS

Robot = Annotated[
    str, typer.Option(metavar="NAME", help="The nominal robot: a shipped one, or a robot file.")
]
Scenario = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="The simulated cell: a shipped scenario, or a cell file.",
        show_default="paper-prototype, without a real cell",
    ),
]
Controller = Annotated[
    str | None,
    typer.Option(
        metavar="URL", help="The controller: tcp://HOST:PORT, serial:///dev/ttyUSB0?baud=115200"
    ),
]
Tracker = Annotated[str | None, typer.Option(metavar="URL", help="The tracker: tcp://HOST:700")]
Offline = Annotated[
    bool,
    typer.Option(
        "--offline", help="No device is connected: programs go out, measured files come in."
    ),
]
ControllerDriver = Annotated[
    str | None, typer.Option(metavar="NAME", help=f"Its protocol: {', '.join(CONTROLLERS)}.")
]
TrackerDriver = Annotated[
    str | None, typer.Option(metavar="NAME", help=f"Its protocol: {', '.join(TRACKERS)}.")
]


def command(
    context: typer.Context,
    folder: NewFolder,
    *,
    robot: Robot = DEFAULT_ROBOT,
    scenario: Scenario = None,
    controller: Controller = None,
    tracker: Tracker = None,
    offline: Offline = False,
    controller_driver: ControllerDriver = None,
    tracker_driver: TrackerDriver = None,
    json: Json = False,
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
    if offline and any((controller, tracker, scenario, controller_driver, tracker_driver)):
        raise OptionsInvalid(
            "--offline is for a campaign without devices", remedy="leave addresses and drivers out"
        )
    if offline:
        controller = tracker = OFFLINE
    if (controller is None) != (tracker is None):
        raise OptionsInvalid("--controller or --tracker is missing", remedy="give both, or neither")
    urls = {"controller": controller, "tracker": tracker}
    simulated = [url for url in urls.values() if url is not None and url.startswith(SIMULATED)]
    if controller is not None and scenario is not None and len(simulated) != 1:
        raise OptionsInvalid(
            "--scenario is for a simulated cell, --controller for a real one", remedy="give one"
        )
    if controller is None and controller_driver is not None:
        raise OptionsInvalid(
            "--controller-driver is for a real controller: a simulated one speaks robotline",
            remedy="give --controller and --tracker too, or leave it out",
        )
    terminal = terminal_of(context, as_json=json)
    drivers = {"controller": controller_driver, "tracker": tracker_driver}
    if controller is not None and tracker is not None and len(simulated) != 1:
        config = create_for_devices(folder, robot, controller, tracker, drivers)
    else:
        named = simulated[0].removeprefix(SIMULATED) if simulated else DEFAULT_SCENARIO
        real = {device: None if url in simulated else url for device, url in urls.items()}
        named = scenario or (DEFAULT_SCENARIO if named == "cell" else named)
        config = create_simulated(folder, robot, named, urls=real, drivers=drivers)
    urls = {"controller": config.controller.url, "tracker": config.tracker.url}
    devices = OFFLINE if offline else f"with {urls['controller']} and {urls['tracker']}"
    terminal.say(f"made: {folder}, {devices}")
    following = tell_next(terminal, open_campaign(folder))
    terminal.document({"folder": str(folder), **urls} | following)
