"""Simulated devices: which series were not measured on real ones, as their records say."""

from collections.abc import Iterable, Mapping

from campaigns.journal.records import SeriesStarted
from campaigns.journal.views import Series
from drivers.values import Identity

SCHEME = "sim://"
VENDOR = "pkmcal"
"""By which a simulated cell names itself, also where it is served to others."""
MODELS = frozenset({"SIM-LT", "SIM-TS"})
"""Names of simulated trackers, whose wires have no word for a vendor; SIM-TS in old journals."""
NO_REAL_ROBOT = "Simulated cell: no real robot was measured."
DEVICES = ("controller", "tracker")


def simulated_devices(series: Iterable[Series], *, planned: bool) -> str:
    """Name the devices that were simulated, in a sentence; empty if all were real.

    Shots that were imported come from none of ours. `planned`: whether campaign.yaml names a
    simulated cell, which counts as long as there is no series at all.
    """
    every = tuple(series)
    series_of = {
        name: tuple(each.number for each in every if name in simulated_in(each.started))
        for name in DEVICES
    }
    numbers = tuple(each.number for each in every)
    everything = all(each == numbers for each in series_of.values()) if every else planned
    if everything:
        return NO_REAL_ROBOT
    parts = [f"the {name} of series {_listed(each)}" for name, each in series_of.items() if each]
    return f"Simulated: {'; '.join(parts)}." if parts else ""


def simulated_in(started: SeriesStarted) -> tuple[str, ...]:
    """Return the simulated devices of a series, by their address or identity."""
    if started.imported:
        return ()
    identities = {"controller": started.robot, "tracker": started.tracker}
    return tuple(
        name
        for name in DEVICES
        if _address(started.configuration, name).startswith(SCHEME)
        or _calls_itself_simulated(identities[name])
    )


def _address(settings: Mapping[str, object], device: str) -> str:
    section = settings.get(device)
    return str(section.get("url", "")) if isinstance(section, Mapping) else ""


def _calls_itself_simulated(identity: Identity | None) -> bool:
    return identity is not None and (identity.vendor == VENDOR or identity.model in MODELS)


def _listed(numbers: tuple[int, ...]) -> str:
    return ", ".join(map(str, numbers))
