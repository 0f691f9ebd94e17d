"""Set-up of an emScon tracker before it measures, and whether it still holds."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from drivers.emscon.client import EmsconClient, EmsconDeadlines
from drivers.errors import DeviceNotReady, DeviceRefused
from drivers.session import changed, require_kept
from drivers.texts import named_instead
from drivers.wire import emscon_constants as constants
from drivers.wire import emscon_messages as bodies
from drivers.wire.emscon_constants import Command, LaserStatus

UNITS = bodies.Units(
    constants.LengthUnit.MILLIMETRE,
    constants.AngleUnit.DEGREE,
    constants.TemperatureUnit.CELSIUS,
    constants.PressureUnit.MILLIBAR,
    constants.RELATIVE_PERCENT,
)
CARTESIAN = bodies.Code(constants.RIGHT_HANDED_RECTANGULAR)
STATIONARY = bodies.Code(constants.STATIONARY)
ADM_ON = 1
SEARCH_RADIUS_MM = 50.0
"""How far around a place a lost reflector is looked for."""

LASER_REMEDIES: dict[int, str] = {
    LaserStatus.COMMUNICATION_FAILED: "check the cable to the tracker head and restart the tracker",
    LaserStatus.HEATING_UP: "wait until the tracker says that it is warm, then start again",
    LaserStatus.UNABLE_TO_STABILIZE: "restart the tracker; if it comes back, have it serviced",
    LaserStatus.OFF: "switch the laser on and let it warm up",
}
"""States in which the laser cannot be used. `NOT_AVAILABLE` is none: an AT40x has only an ADM."""


@dataclass(frozen=True, slots=True)
class Preparation:
    """Preparation wanted for a campaign."""

    reflector: str
    measuring_time_s: float


Settings = Mapping[str, bodies.Body]
"""Settings by name, as read back, that decide what the numbers of a result mean."""


def set_up(client: EmsconClient, wanted: Preparation, deadlines: EmsconDeadlines) -> Settings:
    """Bring the tracker to what is wanted and return its settings as it then has them.

    Initialises a tracker that isn't, which turns its head. Raises `DeviceNotReady` while the laser
    isn't warm and for a reflector that the tracker doesn't know, else `DeviceRefused`.
    """
    client.tell(Command.SET_UNITS, UNITS)
    client.tell(Command.SET_COORDINATE_SYSTEM_TYPE, CARTESIAN)
    _initialise(client, deadlines.initialise_s)
    identifier = _identifier(client, wanted.reflector)
    client.tell(Command.SET_REFLECTOR, bodies.Code(identifier))
    client.tell(Command.SET_MEASUREMENT_MODE, STATIONARY)
    time_ms = round(wanted.measuring_time_s * 1e3)
    client.tell(Command.SET_STATIONARY_MODE_PARAMS, bodies.StationaryMode(time_ms, ADM_ON))
    _set_statistics(client)
    timeout_ms = round(deadlines.search_timeout_s * 1e3)
    client.tell(Command.SET_SEARCH_PARAMS, bodies.SearchParams(SEARCH_RADIUS_MM, timeout_ms))
    _set_switches(client)
    settings = read_settings(client)
    _require_kept(client.name, settings, identifier)
    _require_time_kept(client.name, settings["stationary mode"], time_ms)
    return settings


def read_settings(client: EmsconClient) -> Settings:
    """Read back everything that decides what a result means."""
    return {
        "units": client.ask(Command.GET_UNITS, bodies.Units),
        "coordinate system": client.ask(Command.GET_COORDINATE_SYSTEM_TYPE, bodies.Code),
        "measurement mode": client.ask(Command.GET_MEASUREMENT_MODE, bodies.Code),
        "stationary mode": client.ask(Command.GET_STATIONARY_MODE_PARAMS, bodies.StationaryMode),
        "reflector": client.ask(Command.GET_REFLECTOR, bodies.Code),
        "switches": client.ask(Command.GET_SYSTEM_SETTINGS, bodies.SystemSettings),
    }


def require_unchanged(client: EmsconClient, agreed: Settings) -> None:
    """Raise `DeviceNotReady` when somebody else has changed what a result means."""
    if not client.settings_in_doubt():
        return
    with client.confirming_settings():
        current = read_settings(client)
        if current != agreed:
            raise DeviceNotReady(
                f"{client.name}: another program changed the tracker's {changed(agreed, current)}",
                remedy="end the other program, then start again: the tracker will be prepared anew",
            )


def require_laser(where: str, status: bodies.SystemStatus) -> None:
    """Raise `DeviceNotReady` while the laser cannot be used."""
    if is_warm(status):
        return
    state = LaserStatus(status.laser_status).name.replace("_", " ").lower()
    raise DeviceNotReady(
        f"{where}: the laser is not ready: {state}", remedy=LASER_REMEDIES[status.laser_status]
    )


def is_warm(status: bodies.SystemStatus) -> bool:
    """Whether the laser can be used."""
    return status.laser_status not in LASER_REMEDIES


def is_initialised(status: bodies.SystemStatus) -> bool:
    """Whether the tracker has climbed its start-up ladder to the end."""
    return status.processor_status == constants.ProcessorStatus.INITIALIZED


def _initialise(client: EmsconClient, within_s: float) -> None:
    status = client.ask(Command.GET_SYSTEM_STATUS, bodies.SystemStatus)
    require_laser(client.name, status)
    if not is_initialised(status):
        client.tell(Command.INITIALIZE, within_s=within_s)


def _identifier(client: EmsconClient, name: str) -> int:
    entries = client.reflectors()
    for entry in entries:
        if entry.name == name:
            return entry.identifier
    raise DeviceNotReady(
        f"{client.name}: the tracker has no reflector '{name}'",
        remedy=named_instead(
            name,
            [entry.name for entry in entries],
            listed="it knows",
            otherwise="define the reflector in the tracker's own software",
        ),
    )


def _set_statistics(client: EmsconClient) -> None:
    """Ask for covariances; an instrument without them answers with standard deviations alone."""
    extended = bodies.StatisticMode(constants.Statistics.EXTENDED, constants.Statistics.EXTENDED)
    client.ask_or_none(Command.SET_STATISTIC_MODE, bodies.Nothing, extended)


def _set_switches(client: EmsconClient) -> None:
    """Ask for points in the instrument's own frame; the weather station stays as it is."""
    present = client.ask(Command.GET_SYSTEM_SETTINGS, bodies.SystemSettings)
    wanted = replace(
        present,
        apply_transformation=0,
        apply_station_orientation=0,
        keep_last_position=1,
        send_unsolicited_messages=1,
        send_reflector_position=0,
        try_measurement_mode=0,
    )
    client.tell(Command.SET_SYSTEM_SETTINGS, wanted)


def _require_kept(where: str, settings: Settings, identifier: int) -> None:
    switches = settings["switches"]
    assert isinstance(switches, bodies.SystemSettings), "asked for as these"
    wanted: dict[str, bodies.Body]
    wanted = {"units": UNITS, "coordinate system": CARTESIAN, "measurement mode": STATIONARY}
    wanted["reflector"] = bodies.Code(identifier)
    kept = {name: settings[name] == body for name, body in wanted.items()} | {
        "own frame": not (switches.apply_transformation or switches.apply_station_orientation),
        "unsolicited messages": bool(switches.send_unsolicited_messages),
    }
    remedy = "end other programs that use the tracker, then start again"
    require_kept(f"{where}: the tracker", kept, remedy=remedy)


def _require_time_kept(where: str, mode: bodies.Body, wanted_ms: int) -> None:
    """Raise `DeviceRefused` when the tracker measures for another time than it was told to."""
    assert isinstance(mode, bodies.StationaryMode), "asked for as this"
    if (found_ms := mode.time_ms) != wanted_ms:
        raise DeviceRefused(
            f"{where}: the tracker's measuring time is {found_ms} ms after {wanted_ms} ms was set",
            remedy="set tracker.measuring_time_s in campaign.yaml to a time that it keeps, and end "
            "other programs that use the tracker",
        )
