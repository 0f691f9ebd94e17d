"""The drivers' names in campaign.yaml, and the addresses of those without a wire.

Settings and options offer and check these names; they need no driver for that, so they load none.
"""

from typing import Literal, get_args

TrackerName = Literal["emscon", "pointline", "by-hand", "watch-file"]
ControllerName = Literal["robotline", "by-hand"]
TRACKER_NAMES: tuple[TrackerName, ...] = get_args(TrackerName)
CONTROLLER_NAMES: tuple[ControllerName, ...] = get_args(ControllerName)
BY_HAND: Literal["by-hand"] = "by-hand"
"""Driver and address of a device that a person works by a dialogue at the terminal."""
FILE = "file:"
"""Beginning of the address of a tracker whose software writes into a file."""
ADDRESSES: dict[str, str] = {BY_HAND: BY_HAND, "watch-file": FILE}
"""Beginning of the address of a device without a wire, by its driver."""


def driver_of_address(url: str) -> str | None:
    """Return the only driver of addresses of this form; None for those of a wire and others."""
    return next((name for name, start in ADDRESSES.items() if url.startswith(start)), None)
