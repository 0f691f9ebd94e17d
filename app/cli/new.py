"""pkmcal new: a campaign's folder."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.options import Folder, Json

if TYPE_CHECKING:
    from campaigns.settings.config import CampaignConfig
    from sim.scenarios.tracker import DataSheet

DEFAULT_ROBOT = "par4-prototype"
DEFAULT_SCENARIO = "paper-prototype"
DEFAULT_REFLECTOR = "CCR-1.5in"
SIMULATED_SPEED_PERCENT = 50.0
LIMIT_DIGITS = 4
"""Of a limit in µm: more than any data sheet has."""


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


def command(
    context: typer.Context,
    folder: Folder,
    *,
    robot: Robot = DEFAULT_ROBOT,
    scenario: Scenario = None,
    controller: Controller = None,
    tracker: Tracker = None,
    json: Json = False,
) -> None:
    """Make a campaign's folder: settings and nominal robot.

    campaign.yaml explains each of its keys. With --controller and --tracker it is for a real
    cell, otherwise it gets a simulated one, whose every error stands in cell.yaml.

    pkmcal new first-try

    pkmcal new cell-3 --controller tcp://192.168.0.10:5020 --tracker tcp://192.168.0.1:700
    """
    from app.console import terminal_of
    from app.exits import UsageInvalid

    if (controller is None) != (tracker is None):
        raise UsageInvalid("--controller or --tracker is missing", remedy="give both, or neither")
    if controller is not None and scenario is not None:
        raise UsageInvalid(
            "--scenario is for a simulated cell, --controller for a real one", remedy="give one"
        )
    terminal = terminal_of(context, as_json=json)
    if controller is not None and tracker is not None:
        config = create_for_devices(folder, robot, controller, tracker)
        todo = f"look through campaign.yaml (tracker.place_mm!), then: pkmcal devices {folder}"
    else:
        config = create_simulated(folder, robot, scenario or DEFAULT_SCENARIO)
        todo = f"pkmcal plan {folder}"
    urls = {"controller": config.controller.url, "tracker": config.tracker.url}
    terminal.say(f"made: {folder}, with {urls['controller']} and {urls['tracker']}")
    terminal.note(f"next: {todo}")
    terminal.document({"folder": str(folder), **urls})


def create_for_devices(folder: Path, robot: str, controller: str, tracker: str) -> "CampaignConfig":
    """A campaign on real devices; raises `ConfigInvalid`, `OutputExists` or `WriteFailed`."""
    from campaigns.robots.robot import find_robot
    from campaigns.settings.config import new_config, write_new_campaign

    config = new_config(
        {
            "name": folder.resolve().name,
            "controller": {"url": controller},
            "tracker": {"url": tracker, "reflector": DEFAULT_REFLECTOR},
        }
    )
    write_new_campaign(folder, config, find_robot(robot))
    return config


def create_simulated(
    folder: Path, robot: str, scenario: str, seed: int | None = None
) -> "CampaignConfig":
    """A campaign on a simulated cell, whose scenario is kept in the folder as cell.yaml."""
    from app.folder import SCENARIO, SIMULATED
    from campaigns.files.text_file import make_folder, refuse_existing
    from campaigns.robots.robot import find_robot
    from campaigns.settings.config import new_config, write_new_campaign
    from sim.scenarios.scenario import load_scenario, scenario_text

    tracker = load_scenario(scenario).tracker
    url = SIMULATED + SCENARIO.removesuffix(".yaml")
    config = new_config(
        {
            "name": folder.resolve().name,
            "controller": {"url": url, "speed_percent": SIMULATED_SPEED_PERCENT},
            "tracker": {
                "url": url,
                "reflector": tracker.reflectors[0].name,
                "place_mm": [tracker.station.x_mm, tracker.station.y_mm, tracker.station.z_mm],
                "uncertainty": _limits(tracker.noise.data_sheet),
            },
        }
    )
    nominal = find_robot(robot)
    refuse_existing(folder / "campaign.yaml")
    make_folder(folder)
    _write_unless_same(folder / SCENARIO, scenario_text(scenario, seed))
    write_new_campaign(folder, config, nominal)
    return config


def _limits(data_sheet: "DataSheet") -> dict[str, float]:
    """What to plan by; nothing, so the defaults, for a tracker without any noise."""
    noisy = min(data_sheet.along_um, data_sheet.across_um) > 0.0
    limits = data_sheet._asdict() if noisy else {}
    return {name: round(limit, LIMIT_DIGITS) for name, limit in limits.items()}


def _write_unless_same(path: Path, text: str) -> None:
    """Write a new file; one that an attempt before has left is taken as it is."""
    from campaigns.errors import OutputExists
    from campaigns.files.text_file import read_text, write_new_text

    if not path.exists() or read_text(path, OutputExists, if_missing="try again") != text:
        write_new_text(path, text)
