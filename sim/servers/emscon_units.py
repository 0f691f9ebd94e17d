"""Units on the emScon wire: messages in a client's units, from and to mm, rad, °C and hPa."""

from collections.abc import Callable
from dataclasses import fields, replace
from math import pi, radians
from typing import Any, TypeVar, cast

from drivers.wire import emscon_constants
from drivers.wire import emscon_messages as said

MM_PER_UNIT: dict[int, float] = {
    emscon_constants.LengthUnit.METRE: 1000.0,
    emscon_constants.LengthUnit.MILLIMETRE: 1.0,
    emscon_constants.LengthUnit.MICRON: 0.001,
    emscon_constants.LengthUnit.FOOT: 304.8,
    emscon_constants.LengthUnit.YARD: 914.4,
    emscon_constants.LengthUnit.INCH: 25.4,
}
RAD_PER_UNIT: dict[int, float] = {
    emscon_constants.AngleUnit.RADIAN: 1.0,
    emscon_constants.AngleUnit.DEGREE: radians(1.0),
    emscon_constants.AngleUnit.GON: pi / 200.0,
}
HPA_PER_UNIT: dict[int, float] = {
    emscon_constants.PressureUnit.MILLIBAR: 1.0,
    emscon_constants.PressureUnit.HECTOPASCAL: 1.0,
    emscon_constants.PressureUnit.KILOPASCAL: 10.0,
    emscon_constants.PressureUnit.MM_MERCURY: 1.33322,
    emscon_constants.PressureUnit.PSI: 68.94757,
    emscon_constants.PressureUnit.INCH_WATER: 2.49082,
    emscon_constants.PressureUnit.INCH_MERCURY: 33.86379,
}
POWER_ON_UNITS = said.Units(
    emscon_constants.LengthUnit.METRE,
    emscon_constants.AngleUnit.RADIAN,
    emscon_constants.TemperatureUnit.CELSIUS,
    emscon_constants.PressureUnit.MILLIBAR,
    emscon_constants.RELATIVE_PERCENT,
)
QUANTITIES: dict[type[said.Body], str] = {
    said.StationOrientation: "la",
    said.Transformation: "la-",
    said.SearchParams: "l-",
    said.BeamTarget: "l-",
    said.ReflectorPlace: "l",
    said.ApproximateDistance: "l",
    said.Direction: "aa",
    said.Environment: "tp-",
    said.ReflectorEntry: "---l-",
    said.ReflectorPosition: "-l",
    said.SingleResult: "---lllllltp-",
    said.SingleResult2: "---lllslllstp-",
}
"""Of each field: length, its square, angle, temperature, pressure, or - for what has no unit."""

Message = TypeVar("Message", bound=said.Body)


def first_unknown(units: said.Units) -> int | None:
    """Return the number, from 1, of the first parameter that names no unit."""
    known = (
        units.length in MM_PER_UNIT,
        units.angle in RAD_PER_UNIT,
        units.temperature in set(emscon_constants.TemperatureUnit),
        units.pressure in HPA_PER_UNIT,
        units.humidity == emscon_constants.RELATIVE_PERCENT,
    )
    return None if all(known) else 1 + known.index(False)


def told(message: Message, units: said.Units) -> Message:
    """Convert a message for the wire, in the units that its client has chosen."""
    mm, rad = MM_PER_UNIT[units.length], RAD_PER_UNIT[units.angle]
    is_celsius = units.temperature == emscon_constants.TemperatureUnit.CELSIUS
    return _converted(
        message,
        {
            "l": lambda value: value / mm,
            "s": lambda value: value / mm / mm,
            "a": lambda value: value / rad,
            "t": lambda value: value if is_celsius else 1.8 * value + 32.0,
            "p": lambda value: value / HPA_PER_UNIT[units.pressure],
        },
    )


def heard(message: Message, units: said.Units) -> Message:
    """Convert a message from the wire; nobody tells a tracker the weather that it obeys."""
    mm, rad = MM_PER_UNIT[units.length], RAD_PER_UNIT[units.angle]
    return _converted(message, {"l": lambda value: value * mm, "a": lambda value: value * rad})


def _converted(message: Message, convert: dict[str, Callable[[float], float]]) -> Message:
    quantities = QUANTITIES.get(type(message))
    if quantities is None:
        return message
    changes: dict[str, Any] = {}
    for quantity, slot in zip(quantities, fields(cast("Any", message)), strict=True):
        if of_one := convert.get(quantity):
            value = getattr(message, slot.name)
            each = isinstance(value, tuple)
            changes[slot.name] = tuple(map(of_one, value)) if each else of_one(value)
    return cast("Message", replace(cast("Any", message), **changes))
