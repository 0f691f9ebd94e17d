"""Units on the emScon wire: messages in a client's units, from and to mm, rad, °C and hPa.

An emScon packet does not state its units. They are a setting of the instrument, which any client
may change for all, so that a number on the wire can be read only by who knows the present setting.
The simulated instrument computes in mm, rad, °C and hPa; each message is converted at the border.
"""

from collections.abc import Callable
from dataclasses import fields, replace
from math import pi, radians
from typing import Any, TypeVar, cast

from drivers.wire import emscon_messages as said

MM_PER_UNIT = (1000.0, 1.0, 0.001, 304.8, 914.4, 25.4)
"""By emScon's number of the unit: metre, millimetre, micron, foot, yard, inch."""
RAD_PER_UNIT = (1.0, radians(1.0), pi / 200.0)
"""By emScon's number of the unit: radian, degree, gon."""
FAHRENHEIT = 1
"""emScon's number of °F; 0 is °C."""
HPA_PER_UNIT = (1.0, 1.0, 10.0, 1.33322, 68.94757, 2.49082, 33.86379)
"""By emScon's number of the unit: mbar, hPa, kPa, mm of mercury, psi, inch of water, of mercury."""
POWER_ON_UNITS = said.Units(length=0, angle=0, temperature=0, pressure=0, humidity=0)
"""Metre, radian, °C, mbar, % relative humidity."""
QUANTITIES: dict[type[said.Body], str] = {
    said.SearchParams: "l-",
    said.BeamTarget: "l-",
    said.ApproximateDistance: "l",
    said.Direction: "aa",
    said.Environment: "tp-",
    said.ReflectorEntry: "---l-",
    said.ReflectorPosition: "-l",
    said.SingleResult: "---lllllltp-",
    said.SingleResult2: "---lllslllstp-",
}
"""Quantity of each field: l length, s its square, a angle, t temperature, p pressure, - no unit."""

Message = TypeVar("Message", bound=said.Body)


def are_known(units: said.Units) -> tuple[bool, ...]:
    """Return for each parameter of `SetUnits`, in order, whether it is the number of a unit."""
    return (
        units.length in range(len(MM_PER_UNIT)),
        units.angle in range(len(RAD_PER_UNIT)),
        units.temperature in {0, FAHRENHEIT},
        units.pressure in range(len(HPA_PER_UNIT)),
        units.humidity == 0,
    )


def to_wire(message: Message, units: said.Units) -> Message:
    """Convert a message of the instrument to the units that are set."""
    mm, rad = MM_PER_UNIT[units.length], RAD_PER_UNIT[units.angle]
    is_celsius = units.temperature != FAHRENHEIT
    return _convert(
        message,
        {
            "l": lambda value: value / mm,
            "s": lambda value: value / mm / mm,
            "a": lambda value: value / rad,
            "t": lambda value: value if is_celsius else 1.8 * value + 32.0,
            "p": lambda value: value / HPA_PER_UNIT[units.pressure],
        },
    )


def from_wire(message: Message, units: said.Units) -> Message:
    """Convert a client's message from the units that are set: lengths and angles."""
    # no other quantity of a client has an effect: weather that it sets is accepted and not used
    mm, rad = MM_PER_UNIT[units.length], RAD_PER_UNIT[units.angle]
    return _convert(message, {"l": lambda value: value * mm, "a": lambda value: value * rad})


def _convert(message: Message, convert: dict[str, Callable[[float], float]]) -> Message:
    quantities = QUANTITIES.get(type(message))
    if quantities is None:
        return message
    changes: dict[str, Any] = {}
    for quantity, slot in zip(quantities, fields(cast("Any", message)), strict=True):
        if convert_number := convert.get(quantity):
            value = getattr(message, slot.name)
            is_vector = isinstance(value, tuple)
            changes[slot.name] = (
                tuple(map(convert_number, value)) if is_vector else convert_number(value)
            )
    return cast("Message", replace(cast("Any", message), **changes))
