"""Bodies of emScon packets: dataclass ↔ bytes.

A body's `LAYOUT` has one letter a field: `i` 32-bit integer (also enumerations and flags, 0 or 1),
`d` double, `v` three doubles, `s` text of 32 UTF-16 units. All little endian, without padding.
"""

import struct
from collections.abc import Callable, Iterator
from dataclasses import fields
from typing import Any, ClassVar, TypeVar, cast

from drivers.errors import WireError

Triple = tuple[float, float, float]

TEXT_BYTES = 64
_STRUCT_CODES = {"i": "i", "d": "d", "v": "ddd", "s": f"{TEXT_BYTES}s"}


class Body:
    """What follows a packet's header, or a command's."""

    __slots__ = ()
    LAYOUT: ClassVar[str] = ""


BodyType = TypeVar("BodyType", bound=Body)


def layout_of(kind: type[Body]) -> struct.Struct:
    """Return the body's layout in bytes."""
    return struct.Struct("<" + "".join(_STRUCT_CODES[code] for code in kind.LAYOUT))


def decode_body(kind: type[BodyType], data: bytes) -> BodyType:
    """Read a body; raises `WireError` unless it has exactly its size."""
    layout = layout_of(kind)
    if len(data) != layout.size:
        raise WireError(f"{kind.__name__} has {len(data)} bytes, {layout.size} are expected")
    values = iter(layout.unpack(data))
    make = cast("Callable[..., BodyType]", kind)
    return make(*(_field(code, values) for code in kind.LAYOUT))


def encode_body(body: Body) -> bytes:
    """Write a body; raises `ValueError` for a text that is too long."""
    values: list[Any] = []
    for code, field in zip(body.LAYOUT, fields(cast("Any", body)), strict=True):
        value = getattr(body, field.name)
        values += value if code == "v" else [_text_bytes(value) if code == "s" else value]
    return layout_of(type(body)).pack(*values)


def _field(code: str, values: Iterator[Any]) -> object:
    if code == "v":
        return next(values), next(values), next(values)
    value = next(values)
    return _text(value) if code == "s" else value


def _text(data: bytes) -> str:
    return data.decode("utf-16-le", errors="replace").partition("\0")[0]


def _text_bytes(text: str) -> bytes:
    data = text.encode("utf-16-le")
    if len(data) > TEXT_BYTES - 2:
        raise ValueError(f"text '{text}' has more than {TEXT_BYTES // 2 - 1} UTF-16 units")
    return data.ljust(TEXT_BYTES, b"\0")
