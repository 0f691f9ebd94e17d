"""Set-up of an emScon tracker before it measures, and whether it still holds.

Numbers of a result carry no unit, frame or mode: those are settings, which every program that is
connected can change and which stay over connections. `set_up` therefore sets and reads back all
that decide what a number means, and `require_unchanged` reads them again whenever an event says
that a setting may have changed. docs/reference/emscon.md lists the commands in their order.
"""

from dataclasses import replace

from drivers.emscon.client import EmsconClient, EmsconDeadlines
from drivers.errors import DeviceNotReady, DeviceRefused
from drivers.texts import nearest_word
from drivers.wire import emscon_constants as constants
from drivers.wire import emscon_messages as bodies
from drivers.wire.emscon_constants import Command, LaserStatus

UNITS = bodies.Units(length=1, angle=1, temperature=0, pressure=0, humidity=0)
"""Millimetre, degree, °C, mbar, % relative humidity."""
CARTESIAN = bodies.Code(constants.RIGHT_HANDED_RECTANGULAR)
STATIONARY = bodies.Code(constants.STATIONARY)
ADM_ON = 1
SEARCH_RADIUS_MM = 50.0
"""Radius around a place in which a lost reflector is looked for."""
LASER_REMEDIES: dict[int, str] = {
    LaserStatus.COMMUNICATION_FAILED: "check the cable to the tracker head and restart the tracker",
    LaserStatus.HEATING_UP: "wait until the tracker says that it is warm, then start again",
    LaserStatus.UNABLE_TO_STABILIZE: "restart the tracker; if it comes back, have it serviced",
    LaserStatus.OFF: "switch the laser on and let it warm up",
}
"""States in which the laser cannot be used. `NOT_AVAILABLE` is none: an AT40x has only an ADM."""
SETTINGS: dict[str, tuple[Command, type[bodies.Body]]] = {
    "units": (Command.GET_UNITS, bodies.Units),
    "coordinate system": (Command.GET_COORDINATE_SYSTEM_TYPE, bodies.Code),
    "measurement mode": (Command.GET_MEASUREMENT_MODE, bodies.Code),
    "stationary mode": (Command.GET_STATIONARY_MODE_PARAMS, bodies.StationaryMode),
    "reflector": (Command.GET_REFLECTOR, bodies.Code),
    "switches": (Command.GET_SYSTEM_SETTINGS, bodies.SystemSettings),
}
"""Settings that decide what the numbers of a result mean, and how they are read back."""

Settings = dict[str, bodies.Body]


def set_up(
    client: EmsconClient, reflector: str, measuring_time_s: float, deadlines: EmsconDeadlines
) -> Settings:
    """Prepare the tracker and return its settings as it then has them.

    Initialises the tracker if necessary, which turns its head. Raises `DeviceNotReady` while the
    laser cannot be used or if the tracker lacks the reflector, else `DeviceRefused`.
    """
    # 1. Units and coordinates, before any number is read.
    client.order(Command.SET_UNITS, UNITS)
    client.order(Command.SET_COORDINATE_SYSTEM_TYPE, CARTESIAN)
    # 2. Laser, then Initialize, which turns the head: not for a tracker that cannot measure.
    status = client.ask(Command.GET_SYSTEM_STATUS, bodies.SystemStatus)
    require_laser(client.name, status)
    if not is_initialised(status):
        client.order(Command.INITIALIZE, within_s=deadlines.initialise_s)
    # 3. Reflector, mode, measuring time, search, switches.
    wanted_reflector = bodies.Code(_identifier(client, reflector))
    client.order(Command.SET_REFLECTOR, wanted_reflector)
    client.order(Command.SET_MEASUREMENT_MODE, STATIONARY)
    time_ms = round(measuring_time_s * 1e3)
    client.order(Command.SET_STATIONARY_MODE_PARAMS, bodies.StationaryMode(time_ms, ADM_ON))
    # Covariances; an instrument without them refuses, and states standard deviations alone.
    extended = bodies.StatisticMode(constants.Statistics.EXTENDED, constants.Statistics.EXTENDED)
    client.attempt(Command.SET_STATISTIC_MODE, extended)
    timeout_ms = round(deadlines.search_timeout_s * 1e3)
    client.order(Command.SET_SEARCH_PARAMS, bodies.SearchParams(SEARCH_RADIUS_MM, timeout_ms))
    _set_switches(client)
    # 4. Read back: firmware may accept a setting and keep another one.
    settings = read_settings(client)
    _require_kept(client.name, settings, wanted_reflector, time_ms)
    return settings


def read_settings(client: EmsconClient) -> Settings:
    """Read back all settings that decide what a result means."""
    return {name: client.ask(command, kind) for name, (command, kind) in SETTINGS.items()}


def require_unchanged(client: EmsconClient, agreed: Settings) -> None:
    """Raise `DeviceNotReady` when another program has changed what a result means."""
    # Six questions before each shot would cost time. Without an event nothing has changed.
    changes = client.count_changes()
    if changes == client.changes_confirmed:
        return
    current = read_settings(client)
    if changed := [name for name in agreed if current[name] != agreed[name]]:
        raise DeviceNotReady(
            f"{client.name}: another program changed the tracker's {' and '.join(changed)}",
            remedy="end the other program, then start again: the tracker will be prepared again",
        )
    # Only now: settings that could not be read back, or differ, stay in doubt.
    client.changes_confirmed = changes


def require_laser(where: str, status: bodies.SystemStatus) -> None:
    """Raise `DeviceNotReady` while the laser cannot be used."""
    if is_warm(status):
        return
    state = LaserStatus(status.laser_status).name.replace("_", " ").lower()
    raise DeviceNotReady(
        f"{where}: the laser is not ready: {state}", remedy=LASER_REMEDIES[status.laser_status]
    )


def is_warm(status: bodies.SystemStatus) -> bool:
    """Return whether the laser can be used."""
    return status.laser_status not in LASER_REMEDIES


def is_initialised(status: bodies.SystemStatus) -> bool:
    """Return whether the tracker has climbed its start-up ladder to the end."""
    return status.processor_status == constants.ProcessorStatus.INITIALIZED


def _identifier(client: EmsconClient, name: str) -> int:
    entries = client.reflectors()
    for entry in entries:
        if entry.name == name:
            return entry.identifier
    names = [entry.name for entry in entries]
    remedy = "it knows " + ", ".join(f"'{known}'" for known in names)
    if near := nearest_word(name, names, likeness=0.4):
        remedy = f"perhaps '{near}'; {remedy}"
    raise DeviceNotReady(
        f"{client.name}: the tracker has no reflector '{name}'",
        remedy=remedy if names else "define the reflector in the tracker's own software",
    )


def _set_switches(client: EmsconClient) -> None:
    """Ask for points in the instrument's own frame; the weather station stays as it is."""
    present = client.ask(Command.GET_SYSTEM_SETTINGS, bodies.SystemSettings)
    # Only these six: the others are the operator's, or say what equipment there is.
    wanted = replace(
        present,
        apply_transformation=0,
        apply_station_orientation=0,
        keep_last_position=1,
        send_unsolicited_messages=1,
        send_reflector_position=0,
        try_measurement_mode=0,
    )
    client.order(Command.SET_SYSTEM_SETTINGS, wanted)


def _require_kept(where: str, settings: Settings, reflector: bodies.Code, time_ms: int) -> None:
    """Raise `DeviceRefused` for settings that were accepted but are not reported as set."""
    switches, mode = settings["switches"], settings["stationary mode"]
    assert isinstance(switches, bodies.SystemSettings), "asked for as these"
    assert isinstance(mode, bodies.StationaryMode), "asked for as this"
    is_kept = {
        "units": settings["units"] == UNITS,
        "coordinate system": settings["coordinate system"] == CARTESIAN,
        "measurement mode": settings["measurement mode"] == STATIONARY,
        "reflector": settings["reflector"] == reflector,
        "own frame": not (switches.apply_transformation or switches.apply_station_orientation),
        "unsolicited messages": bool(switches.send_unsolicited_messages),
    }
    if lost := [name for name, kept in is_kept.items() if not kept]:
        raise DeviceRefused(
            f"{where}: the tracker accepted but does not report its {' and '.join(lost)} as set",
            remedy="end other programs that use the tracker, then start again",
        )
    if mode.time_ms != time_ms:
        raise DeviceRefused(
            f"{where}: the tracker's measuring time is {mode.time_ms} ms after {time_ms} ms was "
            "set",
            remedy="set tracker.measuring_time_s in campaign.yaml to a time that it keeps, and end "
            "other programs that use the tracker",
        )
