"""Plausibility of a device's answers: nothing is computed from a value that cannot be.

The bounds stand in `drivers/values.py`; imported shots are held to the same ones.
"""

from collections.abc import Sequence
from math import degrees, hypot

from drivers import values
from drivers.errors import ImplausibleAnswer, NotAMeasurement

RESTART = "restart the device; if it comes back, have it serviced"


def require(where: str, bounds: values.Bounds, value: float, *, which: str = "") -> None:
    """Raise `ImplausibleAnswer` for a value beyond its bounds, in their unit.

    `where` is the device's place, `which` the quantity where it has a name of its own.
    """
    if bounds.holds(value):
        return
    raise ImplausibleAnswer(
        f"{where}: answers what cannot be: {which or bounds.quantity} {value:g}{bounds.unit}, "
        f"possible is {bounds.text()}",
        remedy=RESTART,
    )


def require_joints(where: str, axes: Sequence[values.Coordinate], joints: Sequence[float]) -> None:
    """Raise `ImplausibleAnswer` for joints (rad, mm) of which one cannot be."""
    for axis, value in zip(axes, joints, strict=True):
        bounds, shown = (
            (values.JOINT_ANGLE, degrees(value)) if axis.is_angle else (values.JOINT_LENGTH, value)
        )
        require(where, bounds, shown, which=f"joint {axis.name} at")


def require_point(where: str, point_mm: values.Vector3) -> None:
    """Raise `ImplausibleAnswer` for a point farther than a tracker sees, or not finite.

    Raise `NotAMeasurement` for one in the tracker itself: the fields of an empty result are zeros.
    """
    # No reflector can be at the tracker's own origin.
    if not any(point_mm):
        raise NotAMeasurement(
            f"{where}: the result is empty: its point is 0, 0, 0", remedy="measure the point again"
        )
    require(
        where, values.DISTANCE, hypot(*point_mm), which=f"a point {point_mm} mm at a distance of"
    )


def require_weather(where: str, air: values.Weather) -> None:
    """Raise `ImplausibleAnswer` for air that cannot be measured in."""
    require(where, values.TEMPERATURE, air.temperature_degC)
    require(where, values.PRESSURE, air.pressure_hPa)
    require(where, values.HUMIDITY, air.humidity_percent)
