"""Units on the emScon wire: from and to what the simulated tracker uses (mm, rad, °C, hPa)."""

from dataclasses import dataclass
from math import pi, radians

from drivers.values import Vector3
from drivers.wire.emscon_constants import (
    AngleUnit,
    HumidityUnit,
    LengthUnit,
    PressureUnit,
    TemperatureUnit,
)
from drivers.wire.emscon_messages import Units

MM_PER_UNIT: dict[int, float] = {
    LengthUnit.METRE: 1000.0,
    LengthUnit.MILLIMETRE: 1.0,
    LengthUnit.MICRON: 0.001,
    LengthUnit.FOOT: 304.8,
    LengthUnit.YARD: 914.4,
    LengthUnit.INCH: 25.4,
}
RAD_PER_UNIT: dict[int, float] = {
    AngleUnit.RADIAN: 1.0,
    AngleUnit.DEGREE: radians(1.0),
    AngleUnit.GON: pi / 200.0,
}
HPA_PER_UNIT: dict[int, float] = {
    PressureUnit.MILLIBAR: 1.0,
    PressureUnit.HECTOPASCAL: 1.0,
    PressureUnit.KILOPASCAL: 10.0,
    PressureUnit.MM_MERCURY: 1.33322,
    PressureUnit.PSI: 68.94757,
    PressureUnit.INCH_WATER: 2.49082,
    PressureUnit.INCH_MERCURY: 33.86379,
}
POWER_ON_UNITS = Units(
    LengthUnit.METRE,
    AngleUnit.RADIAN,
    TemperatureUnit.CELSIUS,
    PressureUnit.MILLIBAR,
    HumidityUnit.RELATIVE_PERCENT,
)


def first_unknown(units: Units) -> int | None:
    """Return the number, from 1, of the first parameter that names no unit."""
    known = (
        units.length in MM_PER_UNIT,
        units.angle in RAD_PER_UNIT,
        units.temperature in set(TemperatureUnit),
        units.pressure in HPA_PER_UNIT,
        units.humidity in set(HumidityUnit),
    )
    return None if all(known) else 1 + known.index(False)


@dataclass(frozen=True, slots=True)
class Scale:
    """Converts by one client's choice of units."""

    units: Units

    def length(self, length_mm: float) -> float:
        """Convert a length for the wire."""
        return length_mm / MM_PER_UNIT[self.units.length]

    def length_mm(self, length: float) -> float:
        """Convert a length from the wire."""
        return length * MM_PER_UNIT[self.units.length]

    def point(self, point_mm: Vector3) -> Vector3:
        """Convert a point for the wire."""
        x_mm, y_mm, z_mm = point_mm
        return self.length(x_mm), self.length(y_mm), self.length(z_mm)

    def point_mm(self, point: Vector3) -> Vector3:
        """Convert a point from the wire."""
        x, y, z = point
        return self.length_mm(x), self.length_mm(y), self.length_mm(z)

    def angle(self, angle_rad: float) -> float:
        """Convert an angle for the wire."""
        return angle_rad / RAD_PER_UNIT[self.units.angle]

    def air(self, air: tuple[float, float, float]) -> tuple[float, float, float]:
        """Convert temperature °C, pressure hPa and humidity % for the wire."""
        celsius, hectopascal, humidity = air
        is_celsius = self.units.temperature == TemperatureUnit.CELSIUS
        temperature = celsius if is_celsius else 1.8 * celsius + 32.0
        return temperature, hectopascal / HPA_PER_UNIT[self.units.pressure], humidity
