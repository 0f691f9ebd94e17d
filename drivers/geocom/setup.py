"""What a total station is brought to before it measures, and whether it still is."""

from dataclasses import dataclass
from math import isclose

from geocompy.data import Coordinate
from geocompy.geo.gcdata import EDMModeV2, Measurement, Target

from drivers.agreement import changed, require_kept
from drivers.errors import DeviceNotReady, DeviceRefused
from drivers.geocom.client import GeocomClient
from drivers.geocom.prisms import choose_prism, prism_in_use
from drivers.wire.geocom_constants import Capability

ORIGIN = Coordinate(0.0, 0.0, 0.0)
NO_SCALE = (False, 1.0, 0.0, 0.0, 0.0)
"""Projections leave distances as they are."""


@dataclass(frozen=True, slots=True)
class Settings:
    """Everything that decides what the numbers of a result mean, as read back.

    `station` is the instrument's place and height, `scale` a map projection; lengths in m. None:
    the instrument won't say.
    """

    station: tuple[float, float, float, float]
    target_height: float
    prism_constant: float
    target_type: Target | None
    scale: tuple[bool, float, float, float, float] | None


@dataclass(frozen=True, slots=True)
class Kind:
    """What CSV_GetDeviceConfig says of an instrument."""

    device_class: int
    capabilities: int


def read_kind(client: GeocomClient) -> Kind | None:
    """Return the instrument's class and what it has; None when it won't say.

    Read as numbers, because geocompy refuses classes that came after it.
    """
    found = client.ask_or_none(lambda geocom: geocom.request(5035, (), (int, int)))
    return None if found is None else Kind(*found)


def set_up(client: GeocomClient, prism: str) -> Settings:
    """Bring the instrument to what measuring needs and return its settings as it then has them.

    Points are then in its own frame: station and heights zero, no projection, no refraction.
    Raises `DeviceNotReady` for a prism that it doesn't know, `DeviceRefused` for one that cannot
    aim by itself.
    """
    _require_robotic(client)
    client.tell(lambda geocom: geocom.tmc.do_measurement(Measurement.CLEAR))
    client.attempt(lambda geocom: geocom.bap.set_target_type(Target.REFLECTOR))
    client.attempt(lambda geocom: geocom.tmc.set_edm_mode_v2(EDMModeV2.SINGLE_STANDARD))
    choose_prism(client, prism)
    _set_own_frame(client)
    client.tell(lambda geocom: geocom.aus.switch_user_atr(enabled=True))
    client.tell(lambda geocom: geocom.aus.switch_user_lock(enabled=True))
    settings = read_settings(client)
    _require_kept(client, settings, prism)
    return settings


def read_settings(client: GeocomClient) -> Settings:
    """Read back everything that decides what a result means."""
    place, height = client.ask(lambda geocom: geocom.tmc.get_station())
    return Settings(
        (place.x, place.y, place.z, height),
        client.ask(lambda geocom: geocom.tmc.get_target_height()),
        client.ask(lambda geocom: geocom.tmc.get_prism_correction()),
        client.ask_or_none(lambda geocom: geocom.bap.get_target_type()),
        client.ask_or_none(lambda geocom: geocom.tmc.get_geometric_correction_ppm()),
    )


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
    kind = read_kind(client)
    if kind is None:
        return
    needed = Capability.MOTORISED | Capability.TARGET_RECOGNITION
    if kind.capabilities & needed != needed:
        raise DeviceRefused(
            f"{client.name}: the instrument has no motors or no target recognition "
            f"(class {kind.device_class}, equipment {kind.capabilities:#x})",
            remedy="use an instrument that aims by itself, or measure with other software "
            "and `pkmcal import`",
        )


def _set_own_frame(client: GeocomClient) -> None:
    """Set station and heights to zero; what a simpler instrument lacks it also doesn't apply."""
    client.tell(lambda geocom: geocom.tmc.set_station(ORIGIN, 0.0))
    client.tell(lambda geocom: geocom.tmc.set_target_height(0.0))
    client.attempt(lambda geocom: geocom.tmc.set_refractive_correction(enabled=False))
    client.attempt(lambda geocom: geocom.tmc.set_geometric_correction_ppm(*NO_SCALE))


def _require_kept(client: GeocomClient, settings: Settings, prism: str) -> None:
    in_use = prism_in_use(client)
    kept = {
        "station": not any(settings.station),
        "target height": settings.target_height == 0.0,
        "target type": settings.target_type in {None, Target.REFLECTOR},
        "scale": settings.scale is None or _is_neutral(settings.scale),
        "prism": in_use is None or in_use.name == prism,
    }
    remedy = "leave other programs on the instrument, then start again"
    require_kept(f"{client.name}: the instrument", kept, remedy=remedy)


def _is_neutral(scale: tuple[bool, float, float, float, float]) -> bool:
    automatic, factor, _offset, reduction_ppm, individual_ppm = scale
    is_neutral = isclose(factor, 1.0) and reduction_ppm == individual_ppm == 0.0
    return is_neutral and not automatic
