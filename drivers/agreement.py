"""What a device was told to be, against what it says that it is."""

from collections.abc import Mapping
from dataclasses import fields
from typing import TYPE_CHECKING

from drivers.errors import DeviceRefused

if TYPE_CHECKING:
    from _typeshed import DataclassInstance


def changed(agreed: "DataclassInstance", current: "DataclassInstance") -> str:
    """Return in words the fields in which two readings of one device's settings differ."""
    names = [field.name for field in fields(agreed)]
    return " and ".join(
        name.replace("_", " ") for name in names if getattr(current, name) != getattr(agreed, name)
    )


def require_kept(device: str, kept: Mapping[str, bool], *, remedy: str) -> None:
    """Raise `DeviceRefused` for settings that were accepted but are not reported as set.

    `device` begins the sentence, with where it is.
    """
    lost = [name for name, is_kept in kept.items() if not is_kept]
    if lost:
        raise DeviceRefused(
            f"{device} accepted but does not report its {' and '.join(lost)} as set", remedy=remedy
        )
