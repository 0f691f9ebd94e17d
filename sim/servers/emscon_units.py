"""Units on the emScon wire: from and to what the simulated tracker uses (mm, rad, °C, hPa)."""

from dataclasses import dataclass
from math import pi, radians, sqrt

from drivers.values import Vector3, vector
from drivers.wire.emscon_constants import (
    AngleUnit,
    HumidityUnit,
    LengthUnit,
    Mode,
    PressureUnit,
    ResultStatus,
    TemperatureUnit,
)
from drivers.wire.emscon_messages import SingleResult, SingleResult2, Units
from sim.tracker.instrument import TrackerShot

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

    def angles(self, angles_rad: Vector3) -> Vector3:
        """Convert three angles for the wire."""
        return vector(map(self.angle, angles_rad))

    def angles_rad(self, angles: Vector3) -> Vector3:
        """Convert three angles from the wire."""
        return vector(angle * RAD_PER_UNIT[self.units.angle] for angle in angles)

    def air(self, air: tuple[float, float, float]) -> tuple[float, float, float]:
        """Convert temperature °C, pressure hPa and humidity % for the wire."""
        celsius, hectopascal, humidity = air
        is_celsius = self.units.temperature == TemperatureUnit.CELSIUS
        temperature = celsius if is_celsius else 1.8 * celsius + 32.0
        return temperature, hectopascal / HPA_PER_UNIT[self.units.pressure], humidity


NO_POINTING_ERROR: Vector3 = (0.0, 0.0, 0.0)
"""Distance of the beam from the reflector's centre; the simulated beam is never beside it."""


def result_of(shot: TrackerShot, scale: Scale, *, extended: bool) -> SingleResult | SingleResult2:
    """Write a shot in the client's units.

    The covariance that it was drawn by stands for the observed and for the a-priori one.
    """
    point = scale.point(shot.point_in_tracker_mm)
    std = _std(shot, scale)
    total = sqrt(sum(value * value for value in std))
    air = scale.air((shot.temperature_degC, shot.pressure_hPa, shot.humidity_percent))
    head = (int(ResultStatus.ALL_OK), int(Mode.STATIONARY), 0, point, std, total)
    if not extended:
        return SingleResult(*head, NO_POINTING_ERROR, std, total, *air)
    mixed = _covariance(shot, scale)
    return SingleResult2(*head, mixed, NO_POINTING_ERROR, std, total, mixed, *air)


def _std(shot: TrackerShot, scale: Scale) -> Vector3:
    (xx, _, _), (_, yy, _), (_, _, zz) = shot.covariance_mm2
    return scale.point((sqrt(xx), sqrt(yy), sqrt(zz)))


def _covariance(shot: TrackerShot, scale: Scale) -> Vector3:
    """Return the covariances 12, 13 and 23: squares of lengths."""
    (_, xy, xz), (_, _, yz), _ = shot.covariance_mm2
    return scale.point(scale.point((xy, xz, yz)))
