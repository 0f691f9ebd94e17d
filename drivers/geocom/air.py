"""Humidity from the dry and the wet temperature, in which a total station keeps its air."""

from math import exp

PSYCHROMETER_PER_K = 6.62e-4
"""Of a ventilated psychrometer (Sprung's formula)."""
FREEZING_hPa = 6.112


def relative_humidity_percent(dry_degC: float, wet_degC: float, pressure_hPa: float) -> float:
    """Return it by Sprung's formula, within 0 to 100 %."""
    vapour_hPa = _saturation_hPa(wet_degC) - PSYCHROMETER_PER_K * pressure_hPa * (
        dry_degC - wet_degC
    )
    return min(max(100.0 * vapour_hPa / _saturation_hPa(dry_degC), 0.0), 100.0)


def _saturation_hPa(temperature_degC: float) -> float:  # noqa: N802 - the unit keeps its sign
    """Magnus' formula over water with the coefficients of WMO-No. 8."""
    return FREEZING_hPa * exp(17.62 * temperature_degC / (243.12 + temperature_degC))
