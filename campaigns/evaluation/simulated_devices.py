"""Simulated devices: which series were not measured on real ones, by their records.

A report of a simulated calibration must never pass for one of a real robot. Where a series came
from a simulated cell is decided by what was recorded when it began: the address `sim://`, or the
identity of the device, which a cell also states where it is served to others over a real wire.
"""

from collections.abc import Iterable, Mapping

from campaigns.journal.records import SeriesStarted
from campaigns.journal.views import Series
from drivers.values import Identity

SCHEME = "sim://"
VENDOR = "pkmcal"
"""Vendor that a simulated cell states, also where it is served to others."""
MODELS = frozenset({"SIM-LT", "SIM-TS"})
"""Names of simulated trackers, whose wires have no word for a vendor; SIM-TS in old journals."""
NO_REAL_ROBOT = "Simulated cell: no real robot was measured."
OWN_EQUATIONS = (
    "Its robot moved by the robot file's own equations: plan, files and σ are tested, "
    "the equations are not."
)
"""Remark on a mechanism of one's own, of which the simulated cell has no parts."""
DEVICES = ("controller", "tracker")


def simulated_devices(series: Iterable[Series], *, planned: bool) -> str:
    """Name the devices that were simulated, in a sentence; empty if all were real.

    Imported shots come from no simulated cell. `planned`: whether campaign.yaml names a simulated
    cell, which counts as long as there is no series at all.
    """
    series = tuple(series)
    all_numbers = tuple(measured.number for measured in series)
    simulated = {
        name: tuple(m.number for m in series if name in simulated_in(m.started)) for name in DEVICES
    }
    # One sentence where nothing was real; else each device with its series, for a campaign may mix
    # a real controller with a simulated tracker, or have begun as a dry run.
    is_all_simulated = planned
    if series:
        is_all_simulated = all(numbers == all_numbers for numbers in simulated.values())
    if is_all_simulated:
        return NO_REAL_ROBOT
    parts = [
        f"the {name} of series {', '.join(map(str, numbers))}"
        for name, numbers in simulated.items()
        if numbers
    ]
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
        or _is_simulated(identities[name])
    )


def _address(settings: Mapping[str, object], device: str) -> str:
    section = settings.get(device)
    return str(section.get("url", "")) if isinstance(section, Mapping) else ""


def _is_simulated(identity: Identity | None) -> bool:
    return identity is not None and (identity.vendor == VENDOR or identity.model in MODELS)
