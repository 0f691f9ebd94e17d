"""Prisms by the names that the instrument has for them."""

from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from math import isclose

from geocompy.data import Coordinate
from geocompy.geo.gcdata import EDMModeV2, Measurement, Prism, Target

from drivers.errors import DeviceNotReady, DeviceRefused
from drivers.geocom.client import GeocomClient
from drivers.session import changed, require_kept
from drivers.wire.geocom_constants import Capability

USER_KINDS = frozenset({Prism.USER, Prism.USER1, Prism.USER2, Prism.USER3})
"""Prisms told apart by their names; GeoCOM cannot list them."""


@dataclass(frozen=True, slots=True)
class NamedPrism:
    """A prism type, and its name."""

    kind: Prism
    name: str


def known_prisms(client: GeocomClient) -> list[NamedPrism]:
    """Return the instrument's own prisms, and the one in use if its operator defined it."""
    standard = [
        NamedPrism(kind, definition[0])
        for kind in Prism
        if kind not in USER_KINDS and (definition := _definition(client, kind)) is not None
    ]
    in_use = prism_in_use(client)
    own = [] if in_use is None or in_use.kind not in USER_KINDS else [in_use]
    return [*standard, *own]


def prism_in_use(client: GeocomClient) -> NamedPrism | None:
    """Return the prism that distances are corrected for; None when the instrument won't say."""
    found = client.ask_or_none(lambda geocom: geocom.bap.get_prism_type_name())
    return None if found is None else NamedPrism(*found)


def choose_prism(client: GeocomClient, name: str) -> None:
    """Use the prism of that name; raises `DeviceNotReady` when there is none."""
    known = known_prisms(client)
    standard = [prism.kind for prism in known if prism.name == name]
    if standard and standard[0] not in USER_KINDS:
        client.tell(lambda geocom: geocom.bap.set_prism_type(standard[0]))
        return
    if client.ask_or_none(lambda geocom: geocom.bap.get_user_prism_definition(name)) is None:
        raise DeviceNotReady(
            f"{client.name}: the instrument has no prism '{name}'",
            remedy=_named_instead(name, [prism.name for prism in known]),
        )
    client.tell(lambda geocom: geocom.bap.set_prism_type_name(Prism.USER, name))


def _definition(client: GeocomClient, kind: Prism) -> tuple[str, float, object] | None:
    return client.ask_or_none(lambda geocom: geocom.bap.get_prism_definition(kind))


def _named_instead(name: str, known: Sequence[str]) -> str:
    if not known:
        return "define the prism on the instrument under this name"
    folded = {known_name.lower(): known_name for known_name in known}
    near = get_close_matches(name.lower(), folded, n=1, cutoff=0.4)
    guess = f"perhaps '{folded[near[0]]}'; " if near else ""
    listed = ", ".join(f"'{known_name}'" for known_name in known)
    return f"{guess}define it on the instrument under this name, or take one of {listed}"


ORIGIN = Coordinate(0.0, 0.0, 0.0)
NO_SCALE = (False, 1.0, 0.0, 0.0, 0.0)
"""Projections leave distances as they are."""


@dataclass(frozen=True, slots=True)
class Settings:
    """Settings that decide what the numbers of a result mean, as read back.

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
    """Kind of an instrument by CSV_GetDeviceConfig."""

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
