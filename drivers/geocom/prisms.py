"""Prisms by the names that the instrument has for them."""

from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches

from geocompy.geo.gcdata import Prism

from drivers.errors import DeviceNotReady
from drivers.geocom.client import GeocomClient

USER_KINDS = frozenset({Prism.USER, Prism.USER1, Prism.USER2, Prism.USER3})
"""Told apart by their names; GeoCOM cannot list them."""


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
