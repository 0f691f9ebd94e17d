"""Results of emScon: whose they are, and a covariance that can be used.

A result carries no number that ties it to the StartMeasurement that asked for it. A tracker, or a
program between, that sends an old result again would put each point at the pose before. Three signs
show a result that cannot be of the measurement just started (`require_own`):

1. It equals the result before byte for byte, its scatter included.
2. It came sooner than the measuring time allows.
3. After a failure or a reconnection, a second one follows before the tracker is idle: the failed
   measurement's result came late, and which of the two is which cannot be decided.

Such a result is refused, and the shot is taken again. So is one whose readings scatter as those of
a reflector that moves (`require_still`). A result that passes is then interpreted: point and air
within bounds (`drivers/plausible.py`), and of two covariances the larger usable one.
"""

from math import hypot, isfinite

from drivers import errors, values
from drivers.emscon.client import EmsconClient, Result
from drivers.plausible import require, require_point, require_weather
from drivers.wire import emscon as wire
from drivers.wire import emscon_messages as bodies
from drivers.wire.emscon_constants import STATIONARY

# The last of an instrument's readings lies before the end of its measuring time.
EARLY_SHARE = 0.1
LEAST_EARLY_S = 0.1
"""How much sooner than the measuring time a result may come: this share of it, or these seconds."""
NO_COVARIANCE: values.Vector3 = (0.0, 0.0, 0.0)
LEAST_STD_MM = 1e-7
"""Least value taken for a standard deviation; a zero is a field that the instrument left out."""
MOVING_STD_MM = 0.2
"""Least standard deviation of readings, root of the summed squares, that shows a motion: a robot
that stands and vibrates has some hundredths."""
MOVING_RATIO = 5.0
"""Least ratio to what the instrument's accuracy model states, at long distances."""
SMALLEST_DETERMINANT = 1e-9
"""Determinant of the correlation matrix: less is singular within the rounding of what was sent."""


def require_own(
    client: EmsconClient,
    result: Result,
    *,
    is_repeated: bool,
    after_s: float,
    measuring_time_s: float | None,
) -> None:
    """Raise `NotAMeasurement` for a result that cannot be of the measurement just started.

    `is_repeated`: the result is the one before, byte for byte. It came `after_s` after the start.
    `measuring_time_s` is None where the tracker's time is not known.
    """
    # No instrument observes the same scatter twice, to the last bit. One that states none (zeros)
    # could send the same numbers for a reflector that stands still.
    problem = ""
    if is_repeated and any(value > 0.0 for value in result.std):
        problem = "the result is that of the measurement before, byte for byte"
    elif measuring_time_s is not None and after_s < measuring_time_s - max(
        LEAST_EARLY_S, EARLY_SHARE * measuring_time_s
    ):
        problem = (
            f"a result came {after_s:.3f} s after its measurement was started, "
            f"which takes {measuring_time_s:g} s"
        )
    # This look costs the time until the tracker is idle, and so it is taken only where a result may
    # be under way that no one waits for.
    elif client.may_hear_old_results and client.await_idle_and_see_another_end():
        problem = (
            "a second result followed, and either can be that of an earlier measurement which "
            "failed: neither is taken"
        )
    if problem:
        raise errors.NotAMeasurement(
            f"{client.name}: {problem}",
            remedy="measure again; if it comes back, end other programs that use the tracker, or "
            "restart it (docs/reference/emscon.md#results-that-cannot-be)",
        )


def require_still(name: str, result: Result) -> None:
    """Raise `NotAMeasurement` for a result whose readings show that the reflector moved.

    `name` is the tracker's. Without a stated scatter nothing is known.
    """
    # What the controller reports of a motion may be wrong; the readings are of the target itself.
    observed_mm, stated_mm = hypot(*result.std), hypot(*result.apriori_std)
    limit_mm = max(MOVING_STD_MM, MOVING_RATIO * stated_mm)
    is_stated = all(LEAST_STD_MM < value <= values.SIGMA.most for value in result.std)
    if is_stated and observed_mm > limit_mm:
        raise errors.NotAMeasurement(
            f"{name}: the reflector moved while it was measured: its readings scatter by "
            f"{observed_mm:.2f} mm (1 σ, limit {limit_mm:.2f} mm)",
            remedy="look whether the robot stands when its controller says so (`pkmcal devices DIR "
            "--move`), and for what shakes it",
        )


def measurement_of(where: str, result: Result) -> values.Measurement:
    """Interpret a result in mm, °C and hPa; raises `DeviceRefused` for one that is no data."""
    if result.mode != STATIONARY or result.is_trial:
        raise errors.DeviceRefused(
            f"{where}: a result of mode {result.mode}, trial {result.is_trial}, "
            f"is not the stationary measurement that was asked for",
            remedy="end other programs that use the tracker, then prepare it again",
        )
    air = values.Weather(result.temperature, result.pressure, result.humidity)
    require_point(where, result.point)
    require_weather(where, air)
    return values.Measurement(
        point_in_tracker_mm=result.point,
        covariance_mm2=_covariance(where, result),
        weather=air,
        raw=wire.encode(result).hex(),
    )


def recorded_measurement(raw: str) -> tuple[values.Vector3, values.Matrix3 | None]:
    """Read point, mm, and covariance, mm², from a record; raises `DriverError`."""
    try:
        packet = bytes.fromhex(raw)
    except ValueError as error:
        raise errors.WireError(f"no packet in hexadecimal digits: {raw!r:.80}") from error
    match wire.from_server()(packet):
        case [bodies.SingleResult() | bodies.SingleResult2() as result]:
            measurement = measurement_of("the tracker", result)
            return measurement.point_in_tracker_mm, measurement.covariance_mm2
    raise errors.WireError(f"no single measurement: {raw!r:.80}")


def _covariance(where: str, result: Result) -> values.Matrix3:
    """Return the larger by trace of the observed and the a-priori covariance.

    The observed one is the scatter within this measurement and may be smaller than what the
    instrument can do; the a-priori one comes from its accuracy model alone.
    """
    for value in (*result.std, *result.apriori_std):
        if isfinite(value) and value > 0.0:  # zeros and no numbers are fields that were left out
            require(where, values.SIGMA, value)
    observed, apriori = NO_COVARIANCE, NO_COVARIANCE
    if isinstance(result, bodies.SingleResult2):
        observed, apriori = result.covariance, result.apriori_covariance
    # 1. Each as a matrix, or None where it cannot be used. 2. The one with the larger trace.
    candidates = [_matrix(result.std, observed), _matrix(result.apriori_std, apriori)]
    possible = [matrix for matrix in candidates if matrix]
    if not possible:
        raise errors.NotAMeasurement(
            f"{where}: a result without uncertainty: observed {result.std} mm, "
            f"a priori {result.apriori_std} mm",
            remedy="measure again; if it comes back, look at the tracker's own status",
        )
    return max(possible, key=lambda m: m[0][0] + m[1][1] + m[2][2])


def _matrix(std: values.Vector3, covariance: values.Vector3) -> values.Matrix3 | None:
    """Return the covariance, without correlations if it is not positive definite otherwise.

    None: a standard deviation is missing or impossible.
    """
    if not all(LEAST_STD_MM < value <= values.SIGMA.most for value in std):
        return None
    # Firmware may state correlations in another unit than mm² (unconfirmed); deviations are in mm.
    full = _symmetric(std, covariance)
    possible = values.is_positive_definite(full, SMALLEST_DETERMINANT)
    return full if possible else _symmetric(std, NO_COVARIANCE)


def _symmetric(std: values.Vector3, covariance: values.Vector3) -> values.Matrix3:
    xx, yy, zz = (value * value for value in std)
    xy, xz, yz = covariance
    return (xx, xy, xz), (xy, yy, yz), (xz, yz, zz)
