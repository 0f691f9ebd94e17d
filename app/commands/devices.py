"""pkmcal devices: who answers, and in what state."""

from typing import TYPE_CHECKING

from app.options import Folder, Json

if TYPE_CHECKING:
    from campaigns.shooting import Cell


def command(folder: Folder, *, json: Json = False) -> None:
    """Connect to controller and tracker; say who answers, state, weather, reflectors.

    Nothing moves.
    """
    from app.console import Terminal
    from app.folder import open_campaign
    from app.wiring import connected_cell

    terminal = Terminal(as_json=json)
    with connected_cell(open_campaign(folder)) as cell:
        found = survey(cell)
    for device, lines in found.items():
        terminal.table(device, ("", "value"), [(k, _text(v)) for k, v in lines.items()])
    terminal.document(found)


def survey(cell: "Cell") -> dict[str, dict[str, object]]:
    """What both devices say of themselves."""
    from math import degrees

    robot, state = cell.robot.identity(), cell.robot.state()
    tracker, seen, air = cell.tracker.identity(), cell.tracker.state(), cell.tracker.weather()
    return {
        "controller": {
            "identity": str(robot),
            "serial": robot.serial,
            "joints_deg": [round(degrees(q), 6) for q in state.joints_rad],
            "moving": state.moving,
            "fault": state.fault,
            "emergency_stop": state.emergency_stop,
        },
        "tracker": {
            "identity": str(tracker),
            "serial": tracker.serial,
            "readiness": seen.readiness.value,
            "initialised": seen.initialised,
            "laser_warm": seen.laser_warm,
            "beam_locked": seen.beam_locked,
            "reflector": seen.reflector,
            "reflectors": [reflector.name for reflector in cell.tracker.reflectors()],
            "temperature_degC": air.temperature_degC,
            "pressure_hPa": air.pressure_hPa,
            "humidity_percent": air.humidity_percent,
        },
    }


def _text(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(map(str, value))
    return str(value) or "-"
