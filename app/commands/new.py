"""pkmcal new: a campaign's folder."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.options import Folder

if TYPE_CHECKING:
    from campaigns.config_sections import ControllerConfig, TrackerConfig

DEFAULT_ROBOT = "par4-prototype"
DEFAULT_SCENARIO = "paper-prototype"
DEFAULT_REFLECTOR = "CCR-1.5in"
NEXT_ON_A_CELL = "correct campaign.yaml (tracker.place_mm, reflector), then: pkmcal devices"


def command(
    folder: Folder,
    robot: Annotated[
        str, typer.Option(help="The nominal robot: a shipped one's name, or a robot file.")
    ] = DEFAULT_ROBOT,
    scenario: Annotated[
        str | None, typer.Option(help="Simulated cell: a shipped scenario, or a cell file.")
    ] = None,
    controller: Annotated[
        str | None, typer.Option(metavar="URL", help="Real controller: tcp://… or serial://…")
    ] = None,
    tracker: Annotated[
        str | None, typer.Option(metavar="URL", help="Real tracker: tcp://HOST:700")
    ] = None,
) -> None:
    """Make a campaign's folder: its settings, each explained, and the nominal robot.

    Without addresses it gets a simulated cell to practise on.
    """
    from app.console import Terminal

    if (controller is None) != (tracker is None):
        raise typer.BadParameter("give both --controller and --tracker, or neither")
    if controller is not None and scenario is not None:
        raise typer.BadParameter("give either addresses or a --scenario, not both")
    terminal = Terminal(as_json=False)
    if controller is not None and tracker is not None:
        create_for_devices(folder, robot, controller, tracker)
        terminal.say(f"{folder}: made for {controller} and {tracker}")
        terminal.note(f"next: {NEXT_ON_A_CELL} {folder}")
        return
    create_simulated(folder, robot, scenario or DEFAULT_SCENARIO)
    terminal.say(f"{folder}: made with the simulated cell '{scenario or DEFAULT_SCENARIO}'")
    terminal.note(f"next: pkmcal devices {folder}, or pkmcal plan {folder}")


def create_for_devices(folder: Path, robot: str, controller: str, tracker: str) -> None:
    """A campaign on real devices; raises `ConfigInvalid`, `OutputExists` or `WriteFailed`."""
    from campaigns.config_sections import ControllerConfig, TrackerConfig
    from campaigns.yamlfile import checked_settings

    controller_config = checked_settings({"url": controller}, "--controller", ControllerConfig)
    settings = {"url": tracker, "reflector": DEFAULT_REFLECTOR}
    tracker_config = checked_settings(settings, "--tracker", TrackerConfig)
    _write(folder, robot, controller_config, tracker_config)


def create_simulated(folder: Path, robot: str, scenario: str, seed: int | None = None) -> None:
    """A campaign on a simulated cell, whose scenario is kept in the folder as cell.yaml."""
    from app.folder import SCENARIO
    from app.wiring import SIMULATED
    from campaigns.config_sections import ControllerConfig, TrackerConfig
    from campaigns.textfile import make_folder, refuse_existing, write_new_text
    from sim.scenario import load_scenario
    from sim.scenario_text import scenario_text

    cell = load_scenario(scenario)
    url = SIMULATED + SCENARIO.removesuffix(".yaml")
    station = cell.tracker.station
    tracker = TrackerConfig(
        url=url,
        reflector=cell.tracker.reflectors[0].name,
        place_mm=(station.x_mm, station.y_mm, station.z_mm),
    )
    refuse_existing(folder / "campaign.yaml")
    make_folder(folder)
    write_new_text(folder / SCENARIO, scenario_text(scenario, seed))
    _write(folder, robot, ControllerConfig(url=url, speed_percent=50.0), tracker)


def _write(
    folder: Path, robot: str, controller: "ControllerConfig", tracker: "TrackerConfig"
) -> None:
    from campaigns.config import CampaignConfig, write_new_campaign
    from campaigns.robot import find_robot

    name = folder.resolve().name
    config = CampaignConfig(name=name, controller=controller, tracker=tracker)
    write_new_campaign(folder, config, find_robot(robot))
