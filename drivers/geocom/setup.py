"""Set-up of a total station before it measures: its prism, its frame, and whether both hold."""

from collections.abc import Mapping, Sequence
from math import isclose

from drivers.errors import DeviceNotReady, DeviceRefused
from drivers.geocom.client import GeocomClient, numbers, text, whole, wholes
from drivers.session import changed, require_kept
from drivers.texts import named_instead
from drivers.values import Reflector
from drivers.wire import geocom_constants as constants
from drivers.wire.geocom import parse_words
from drivers.wire.geocom_constants import Program, Rpc

ON, OFF = 1, 0
ORIGIN = (0.0, 0.0, 0.0)
NO_SCALE = (OFF, 1.0, 0.0, 0.0, 0.0)
"""Projections leave distances as they are."""
NO_REFRACTION = (OFF, 6378000, 0.13)
"""Switch, radius of the earth in m, coefficient."""


Settings = Mapping[str, tuple[float, ...] | None]
"""Settings by name, as read back, that decide what the numbers of a result mean.

The station is the instrument's place and height, the scale a map projection; lengths in m. None:
the instrument won't say.
"""


def known_prisms(client: GeocomClient) -> list[Reflector]:
    """Return the instrument's own prisms, and the one in use if its operator defined it.

    GeoCOM knows no offset from a prism to a surface; it is told as 0.
    """
    standard = [
        Reflector(name, kind, 0.0)
        for kind in constants.PRISMS
        if kind not in constants.USER_PRISMS
        and (name := client.ask_or_none(Rpc.BAP_GET_PRISM_DEF, _first_text, kind)) is not None
    ]
    in_use = prism_in_use(client)
    own = [] if in_use is None or in_use.identifier not in constants.USER_PRISMS else [in_use]
    return [*standard, *own]


def prism_in_use(client: GeocomClient) -> Reflector | None:
    """Return the prism that distances are corrected for; None when the instrument won't say."""
    return client.ask_or_none(Rpc.BAP_GET_PRISM_TYPE_2, _named_prism)


def choose_prism(client: GeocomClient, name: str) -> None:
    """Use the prism of that name; raises `DeviceNotReady` when there is none."""
    known = known_prisms(client)
    standard = [prism.identifier for prism in known if prism.name == name]
    if standard and standard[0] not in constants.USER_PRISMS:
        client.tell(Rpc.BAP_SET_PRISM_TYPE, standard[0])
        return
    if not _knows_user_prism(client, name):
        raise DeviceNotReady(
            f"{client.name}: the instrument has no prism '{name}'",
            remedy=named_instead(
                name,
                [prism.name for prism in known],
                listed="define it on the instrument under this name, or take one of",
                otherwise="define the prism on the instrument under this name",
            ),
        )
    client.tell(Rpc.BAP_SET_PRISM_TYPE_2, constants.USER_PRISM, name)


def _knows_user_prism(client: GeocomClient, name: str) -> bool:
    """Whether its operator has defined it; a name beyond ASCII comes with its escapes."""
    if not name.isascii():
        return False
    return client.ask_or_none(Rpc.BAP_GET_USER_PRISM_DEF, _three_words, name) is not None


def class_and_equipment(client: GeocomClient) -> tuple[int, ...] | None:
    """Return CSV_GetDeviceConfig's class and bits of equipment; None when it won't say."""
    return client.ask_or_none(Rpc.CSV_GET_DEVICE_CONFIG, wholes(2))


def set_up(client: GeocomClient, prism: str) -> Settings:
    """Bring the instrument to what measuring needs and return its settings as it then has them.

    Points are then in its own frame: station and heights zero, no projection, no refraction.
    Raises `DeviceNotReady` for a prism that it doesn't know, `DeviceRefused` for one that cannot
    aim by itself.
    """
    _require_robotic(client)
    client.tell(Rpc.TMC_DO_MEASURE, Program.CLEAR, constants.INCLINATION_AUTO)
    client.attempt(Rpc.BAP_SET_TARGET_TYPE, constants.TargetType.REFLECTOR)
    client.attempt(Rpc.TMC_SET_EDM_MODE, constants.EDM_SINGLE_STANDARD)
    choose_prism(client, prism)
    _set_own_frame(client)
    client.tell(Rpc.AUS_SET_USER_ATR_STATE, ON)
    client.tell(Rpc.AUS_SET_USER_LOCK_STATE, ON)
    settings = read_settings(client)
    _require_kept(client, settings, prism)
    return settings


def read_settings(client: GeocomClient) -> Settings:
    """Read back everything that decides what a result means."""
    return {
        "station": client.ask(Rpc.TMC_GET_STATION, numbers(4)),
        "target height": client.ask(Rpc.TMC_GET_HEIGHT, numbers(1)),
        "prism constant": client.ask(Rpc.TMC_GET_PRISM_CORR, numbers(1)),
        "target type": client.ask_or_none(Rpc.BAP_GET_TARGET_TYPE, wholes(1)),
        "scale": client.ask_or_none(Rpc.TMC_GET_GEO_PPM, numbers(5)),
    }


def require_unchanged(client: GeocomClient, agreed: Settings) -> None:
    """Raise `DeviceNotReady` when somebody has changed what a result means."""
    current = read_settings(client)
    if current == agreed:
        return
    raise DeviceNotReady(
        f"{client.name}: somebody changed the instrument's {changed(agreed, current)}",
        remedy="leave the instrument's keys alone, then start again: it will be prepared anew",
    )


def _require_robotic(client: GeocomClient) -> None:
    found = class_and_equipment(client)
    if found is None:
        return
    device_class, equipment = found
    needed = constants.Capability.MOTORISED | constants.Capability.TARGET_RECOGNITION
    if equipment & needed != needed:
        raise DeviceRefused(
            f"{client.name}: the instrument has no motors or no target recognition "
            f"(class {device_class}, equipment {equipment:#x})",
            remedy="use an instrument that aims by itself, or measure with other software "
            "and `pkmcal import`",
        )


def _set_own_frame(client: GeocomClient) -> None:
    """Set station and heights to zero; what a simpler instrument lacks it also doesn't apply."""
    client.tell(Rpc.TMC_SET_STATION, *ORIGIN, 0.0)
    client.tell(Rpc.TMC_SET_HEIGHT, 0.0)
    client.attempt(Rpc.TMC_SET_REFRACTIVE_CORR, *NO_REFRACTION)
    client.attempt(Rpc.TMC_SET_GEO_PPM, *NO_SCALE)


def _require_kept(client: GeocomClient, settings: Settings, prism: str) -> None:
    in_use = prism_in_use(client)
    kept = {
        "station": settings["station"] == (*ORIGIN, 0.0),
        "target height": settings["target height"] == (0.0,),
        "target type": settings["target type"] in {None, (constants.TargetType.REFLECTOR,)},
        "scale": (scale := settings["scale"]) is None or _is_neutral(scale),
        "prism": in_use is None or in_use.name == prism,
    }
    remedy = "leave other programs on the instrument, then start again"
    require_kept(f"{client.name}: the instrument", kept, remedy=remedy)


def _is_neutral(scale: Sequence[float]) -> bool:
    automatic, factor, _offset, reduction_ppm, individual_ppm = scale
    is_neutral = isclose(factor, 1.0) and reduction_ppm == individual_ppm == 0.0
    return is_neutral and not automatic


def _named_prism(words: Sequence[str]) -> Reflector:
    kind, name = parse_words(words, 2)
    return Reflector(text([name]), whole([kind]), 0.0)


def _first_text(words: Sequence[str]) -> str:
    return text(_three_words(words)[:1])


def _three_words(words: Sequence[str]) -> Sequence[str]:
    return parse_words(words, 3)
