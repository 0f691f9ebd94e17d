"""Keys and values that files of earlier versions have, each with what to use instead."""

from collections.abc import Mapping
from typing import Any

_BRIDGE = "use driver robotline with the bridge that runs beside LinuxCNC (docs/how-to/linuxcnc.md)"
VALUES: Mapping[tuple[str, str], str] = {
    ("driver", "geocom"): "use driver pointline and a server for it (docs/reference/pointline.md), "
    "or import its points",
    ("driver", "linuxcnc"): _BRIDGE,
}
"""Remedies by a key's last name and its former value."""
KEYS: Mapping[str, tuple[object, str]] = {
    "controller.linuxcnc": (None, _BRIDGE),
    "mechanics": ({}, "delete it: nothing uses the mechanic's sizes any more"),
    "certificate.measured_by": ("", "write who measured as people.operator"),
}
"""Removed keys of files by dotted path, such as `tracker.two_faces`: former default and remedy.

Earlier versions wrote the default into each new file: there it is read without effect."""


def removed_in_file(path: str, value: object) -> str | None:
    """Return the remedy for a removed key (dotted path from the file's top) or a removed value."""
    if path in KEYS:
        return KEYS[path][1]
    return VALUES.get((path.rpartition(".")[2], str(value)))


def drop_former_defaults(contents: dict[str, Any]) -> None:
    """Delete the removed keys that still have their former default from a file's plain contents."""
    for path, (default, _) in KEYS.items():
        *parents, key = path.split(".")
        section: Any = contents
        for parent in parents:
            section = section.get(parent) if isinstance(section, dict) else None
        if isinstance(section, dict) and key in section and section[key] == default:
            del section[key]
