"""pkmcal devices: who answers, and in what state."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.options import Folder, Json

if TYPE_CHECKING:
    from collections.abc import Mapping

    from drivers.ports import LaserTracker, RobotController


def command(
    context: typer.Context,
    folder: Folder,
    *,
    spy: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write every byte, read out, to a new file."),
    ] = None,
    json: Json = False,
) -> None:
    """Say who answers, and in what state; nothing moves.

    Connects to controller and tracker and shows identities, joints, faults, the tracker's
    start-up, beam, reflectors and weather. What campaign.yaml needs can be read off here: serial
    numbers and the reflector's name.
    """
    from app.byte_log import byte_log
    from app.console import terminal_of
    from app.folder import open_campaign
    from app.wiring import connected_cell

    terminal = terminal_of(context, as_json=json)
    campaign = open_campaign(folder)
    with byte_log(spy, terminal) as log, connected_cell(campaign, log=log) as cell:
        found = {"controller": of_controller(cell.robot), "tracker": of_tracker(cell.tracker)}
    urls = {"controller": campaign.config.controller.url, "tracker": campaign.config.tracker.url}
    for device, facts in found.items():
        terminal.listing(f"{device} at {urls[device]}", _texts(facts))
    terminal.document(found)


def of_controller(robot: "RobotController") -> dict[str, object]:
    """What the controller says of itself."""
    from math import degrees

    identity, state = robot.identity(), robot.state()
    return {
        "identity": str(identity),
        "serial": identity.serial,
        "joints_deg": [round(degrees(q), 6) for q in state.joints_rad],
        "moving": state.moving,
        "fault": state.fault,
        "emergency_stop": state.emergency_stop,
    }


def of_tracker(tracker: "LaserTracker") -> dict[str, object]:
    """What the tracker says of itself and of the air."""
    identity, state, air = tracker.identity(), tracker.state(), tracker.weather()
    return {
        "identity": str(identity),
        "serial": identity.serial,
        "readiness": state.readiness.value,
        "initialised": state.initialised,
        "laser_warm": state.laser_warm,
        "beam_locked": state.beam_locked,
        "reflector": state.reflector,
        "reflectors": [reflector.name for reflector in tracker.reflectors()],
        "temperature_degC": air.temperature_degC,
        "pressure_hPa": air.pressure_hPa,
        "humidity_percent": air.humidity_percent,
    }


def _texts(facts: "Mapping[str, object]") -> dict[str, str]:
    return {name.replace("_", " "): _text(value) for name, value in facts.items()}


def _text(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "none"
    if isinstance(value, float):
        return f"{value:g}"
    return str(value) or "none"
