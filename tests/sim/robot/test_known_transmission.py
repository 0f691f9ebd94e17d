"""Readings of a controller that knows its gears: arms stand where they should, from either side."""

from math import cos, radians, sin

import numpy as np
import pytest

from sim.geometry import PAR4, PLATE_KINDS
from sim.robot.transmission import Transmission, readings_for

JOINTS = np.radians([10.0, -20.0, 35.0, 60.0])
BACKLASH_DEG = 0.1


@pytest.mark.parametrize("motor", [30.0, np.array([30.0, 50.0, 41.0, 100.0])], ids=["one", "each"])
def test_readings_are_those_at_which_the_simulated_gears_have_the_joints(motor):
    phases, size, ripple = (0.3, -1.2), 2e-4, 3e-5
    gears = Transmission(
        eccentricity=np.full(4, size),
        phase_rad=np.full(4, phases[0]),
        ratio=np.full(4, 150e-6),
        ripple=np.full(4, ripple),
        ripple_phase_rad=np.full(4, phases[1]),
        motor_rad=motor,
    )
    flat = {}
    for arm in range(4):
        for name, amplitude, phase in (
            ("eccentricity", size, phases[0]),
            ("ripple", ripple, phases[1]),
        ):
            flat[f"arm{arm}.{name}_sin_deg"] = np.degrees(amplitude) * cos(phase)
            flat[f"arm{arm}.{name}_cos_deg"] = -np.degrees(amplitude) * sin(phase)
        flat[f"arm{arm}.encoder_gain_ppm"] = 150.0
    readings = readings_for(flat, PAR4, motor, JOINTS, JOINTS)
    assert np.abs(readings - JOINTS).max() > 1e-5
    np.testing.assert_allclose(gears.joints(readings), JOINTS, atol=1e-7)


@pytest.mark.parametrize(
    ("present_deg", "ahead"), [(-1.0, 1), (1.0, -1), (0.05, 1), (-0.05, -1), (0.01, 1), (-0.01, -1)]
)
def test_a_joint_takes_up_its_backlash_on_the_way(present_deg, ahead):
    flat = {f"arm{arm}.backlash_deg": BACKLASH_DEG for arm in range(4)}
    readings = readings_for(flat, PAR4, 30.0, JOINTS, JOINTS + radians(present_deg))
    np.testing.assert_allclose(readings - JOINTS, 0.5 * ahead * radians(BACKLASH_DEG), atol=1e-12)


def test_carriages_have_millimetres():
    kind = PLATE_KINDS["linear-delta"]
    flat = {f"arm{arm}.backlash_mm": 0.2 for arm in range(3)}
    readings = readings_for(flat, kind, 0.6, np.zeros(3), np.full(3, -5.0))
    np.testing.assert_allclose(readings, 0.1, atol=1e-9)
