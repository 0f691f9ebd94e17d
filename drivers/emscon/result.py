"""From an emScon result to a measurement with a covariance that can be used."""

from math import isfinite, sqrt

from drivers.errors import DeviceRefused
from drivers.values import Matrix3, Measurement, Vector3, Weather
from drivers.wire.emscon import encode
from drivers.wire.emscon_constants import Mode
from drivers.wire.emscon_messages import SingleResult, SingleResult2

NO_COVARIANCE: Vector3 = (0.0, 0.0, 0.0)
STD_RANGE_MM = (1e-7, 1e3)
"""What is taken for a standard deviation; a zero is a field that the instrument left out."""
SMALLEST_DETERMINANT = 1e-9
"""Of the correlation matrix: less is singular within the rounding of what was sent."""
REMEDY = "measure again; if it comes back, look at the tracker's own status"


def measurement_of(where: str, result: SingleResult | SingleResult2) -> Measurement:
    """Interpret a result in mm, °C and hPa; raises `DeviceRefused` for one that is no data."""
    _check(where, result)
    return Measurement(
        point_in_tracker_mm=result.point,
        covariance_mm2=_covariance(where, result),
        weather=Weather(result.temperature, result.pressure, result.humidity),
        raw=encode(result).hex(),
    )


def _check(where: str, result: SingleResult | SingleResult2) -> None:
    if result.mode != Mode.STATIONARY or result.is_trial:
        raise DeviceRefused(
            f"{where}: a result of mode {result.mode}, trial {result.is_trial}, "
            f"is not the stationary measurement that was asked for",
            remedy="end other programs that use the tracker, then prepare it again",
        )
    air = (result.temperature, result.pressure, result.humidity)
    if not all(map(isfinite, (*result.point, *air))):
        raise DeviceRefused(
            f"{where}: a result without numbers: point {result.point}, air {air}", remedy=REMEDY
        )


def _covariance(where: str, result: SingleResult | SingleResult2) -> Matrix3:
    """Return the larger by trace of the observed and the a-priori covariance.

    The observed one is the scatter within this measurement and may be smaller than what the
    instrument can do; the a-priori one comes from its accuracy model and doesn't know this shot.
    """
    observed, apriori = NO_COVARIANCE, NO_COVARIANCE
    if isinstance(result, SingleResult2):
        observed, apriori = result.covariance, result.apriori_covariance
    candidates = [_matrix(result.std, observed), _matrix(result.apriori_std, apriori)]
    best = max((matrix for matrix in candidates if matrix), key=_trace, default=None)
    if best is None:
        raise DeviceRefused(
            f"{where}: a result without uncertainty: observed {result.std} mm, "
            f"a priori {result.apriori_std} mm",
            remedy=REMEDY,
        )
    return best


def _matrix(std: Vector3, covariance: Vector3) -> Matrix3 | None:
    """Return a positive definite matrix, its diagonal if the whole is none, or None."""
    smallest_mm, largest_mm = STD_RANGE_MM
    if not all(smallest_mm < value < largest_mm for value in std):
        return None
    full = _symmetric(std, covariance)
    return full if _is_positive_definite(full) else _symmetric(std, NO_COVARIANCE)


def _symmetric(std: Vector3, covariance: Vector3) -> Matrix3:
    xx, yy, zz = (value * value for value in std)
    xy, xz, yz = covariance
    return (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)


def _is_positive_definite(matrix: Matrix3) -> bool:
    """Apply Sylvester's criterion to the correlation matrix; NaN fails it."""
    (xx, xy, xz), (_, yy, yz), (_, _, zz) = matrix
    r_xy, r_xz, r_yz = xy / sqrt(xx * yy), xz / sqrt(xx * zz), yz / sqrt(yy * zz)
    squares = r_xy * r_xy + r_xz * r_xz + r_yz * r_yz
    determinant = 1.0 + 2.0 * r_xy * r_xz * r_yz - squares
    return abs(r_xy) < 1.0 and determinant > SMALLEST_DETERMINANT


def _trace(matrix: Matrix3) -> float:
    return matrix[0][0] + matrix[1][1] + matrix[2][2]
