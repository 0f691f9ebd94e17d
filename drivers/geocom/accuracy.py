"""Accuracy of a total station: its class, and the covariance of a point that follows from it."""

from collections.abc import Mapping
from dataclasses import dataclass
from math import acos, atan2, exp, hypot, pi, sqrt

from drivers.values import Matrix3, Vector3

RAD_PER_ARCSEC = pi / 648_000.0
MM_PER_KM = 1e6
PSYCHROMETER_PER_K = 6.62e-4
"""Constant of a ventilated psychrometer (Sprung's formula)."""
FREEZING_hPa = 6.112
BOTH_FACES = sqrt(2.0)
"""ISO 17123-3 states a direction that is observed once in both faces; here one face is observed."""


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Standard deviations, as data sheets state them.

    `angle_arcsec` of a direction by ISO 17123-3; `aiming_mm` of target recognition at short range,
    across the beam each way; `distance_mm` and `distance_ppm` of a distance to a prism by ISO
    17123-4; `target_mm` of the prism's centre, each way. `warned_factor` multiplies them all when
    the instrument warns that a result is not fully corrected: our choice, it gives no number.
    """

    angle_arcsec: float
    distance_mm: float
    distance_ppm: float
    aiming_mm: float = 1.0
    target_mm: float = 0.3
    warned_factor: float = 2.0


UNKNOWN_CLASS = Accuracy(angle_arcsec=5.0, distance_mm=2.0, distance_ppm=2.0)
"""Class of the coarsest instruments with target recognition."""

_ANGLES_ARCSEC: Mapping[int, float] = {
    0: 3.0,
    1: 1.5,
    2: 1.0,
    100: 2.0,
    101: 3.0,
    102: 5.0,
    103: 1.0,
    200: 2.0,
    201: 3.0,
    202: 5.0,
    203: 1.0,
    300: 0.5,
    301: 1.0,
    350: 0.5,
    500: 1.0,
    501: 2.0,
    502: 3.0,
    503: 5.0,
    504: 6.0,
    505: 7.0,
    506: 10.0,
    600: 1.0,
    601: 2.0,
    602: 3.0,
    603: 4.0,
    604: 5.0,
    650: 0.5,
    651: 1.0,
}
"""Standard deviations of angles by the device class of CSV_GetDeviceConfig."""
_FINE_DISTANCES = frozenset({300, 301, 350, 650, 651})
"""Classes of monitoring and industrial instruments, with the finer distance meter."""
_FINE = (0.6, 1.0)
_USUAL = (1.0, 1.5)
_COARSE = (2.0, 2.0)
FIRST_WITH_USUAL_DISTANCES = 600


def accuracy_of_class(device_class: int | None) -> Accuracy:
    """Return what an instrument of that class can do; of an unknown one, `UNKNOWN_CLASS`."""
    if device_class is None or device_class not in _ANGLES_ARCSEC:
        return UNKNOWN_CLASS
    distance_mm, distance_ppm = _distance_of_class(device_class)
    return Accuracy(_ANGLES_ARCSEC[device_class], distance_mm, distance_ppm)


def _distance_of_class(device_class: int) -> tuple[float, float]:
    if device_class in _FINE_DISTANCES:
        return _FINE
    return _USUAL if device_class >= FIRST_WITH_USUAL_DISTANCES else _COARSE


def direction_rad(point_mm: Vector3) -> Vector3 | None:
    """Return Hz (clockwise from north), V (from the zenith) in rad and the distance in mm.

    X is east, Y north, Z up. None for the instrument's own place.
    """
    east, north, up = point_mm
    across = hypot(east, north)
    distance_mm = hypot(across, up)
    if distance_mm == 0.0:
        return None
    return atan2(east, north) % (2.0 * pi), acos(up / distance_mm), distance_mm


def covariance_mm2(point_mm: Vector3, accuracy: Accuracy, *, warned: bool = False) -> Matrix3:
    """Propagate distance, horizontal and vertical angle to a point in the instrument's frame.

    J diag(σ_d², σ_h², σ_v²) Jᵀ + σ_t² I, in which J turns along the beam, across it horizontally
    and across it upward into east, north, up; across, aiming and angle add in squares.
    """
    factor = accuracy.warned_factor if warned else 1.0
    east, north, up = point_mm
    across_mm, distance_mm = hypot(east, north), hypot(east, north, up)
    along = (0.0, 0.0, 1.0) if distance_mm == 0.0 else _scaled(point_mm, 1.0 / distance_mm)
    level = (1.0, 0.0, 0.0) if across_mm == 0.0 else (north / across_mm, -east / across_mm, 0.0)
    sigma_rad = BOTH_FACES * accuracy.angle_arcsec * RAD_PER_ARCSEC
    along_mm = accuracy.distance_mm + accuracy.distance_ppm * distance_mm / MM_PER_KM
    columns = (
        _scaled(along, along_mm),
        _scaled(level, hypot(accuracy.aiming_mm, across_mm * sigma_rad)),
        _scaled(_cross(level, along), hypot(accuracy.aiming_mm, distance_mm * sigma_rad)),
    )
    return _sum_of_squares(columns, accuracy.target_mm, factor)


def _sum_of_squares(columns: tuple[Vector3, ...], target_mm: float, factor: float) -> Matrix3:
    rows = [
        [
            factor**2 * (sum(c[i] * c[j] for c in columns) + (target_mm**2 if i == j else 0.0))
            for j in range(3)
        ]
        for i in range(3)
    ]
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = rows
    return (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)


def _scaled(vector: Vector3, factor: float) -> Vector3:
    x, y, z = vector
    return factor * x, factor * y, factor * z


def _cross(first: Vector3, second: Vector3) -> Vector3:
    (a, b, c), (x, y, z) = first, second
    return b * z - c * y, c * x - a * z, a * y - b * x


def relative_humidity_percent(dry_degC: float, wet_degC: float, pressure_hPa: float) -> float:
    """Return it by Sprung's formula, within 0 to 100 %."""
    vapour_hPa = _saturation_hPa(wet_degC) - PSYCHROMETER_PER_K * pressure_hPa * (
        dry_degC - wet_degC
    )
    return min(max(100.0 * vapour_hPa / _saturation_hPa(dry_degC), 0.0), 100.0)


def _saturation_hPa(temperature_degC: float) -> float:  # noqa: N802 - the unit keeps its sign
    """Magnus' formula over water with the coefficients of WMO-No. 8."""
    return FREEZING_hPa * exp(17.62 * temperature_degC / (243.12 + temperature_degC))
