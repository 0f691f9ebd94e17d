"""Gears and encoders on the real LinuxCNC, by pkmkins with LinuxCNC's own BACKLASH.

They are the simulated robot's.
"""

import numpy as np
import pytest
from command_line import change
from linuxcnc_bench import NEEDS_LINUXCNC, world_controller
from linuxcnc_campaign import Campaign, made_campaign, tell
from test_linuxcnc_full_model import load_although_refused

from sim.factory import transmission, true_geometry
from sim.scenarios.scenario import load_scenario

pytestmark = [*NEEDS_LINUXCNC, pytest.mark.timeout(500), pytest.mark.long]

GEARS = {
    "robot.transmission": {"eccentricity_um": 5.0, "ripple_arcsec": 10.0, "ripples_per_turn": 30.0},
    "robot.backlash_arcmin": [0.3, 0.3, 0.3, 0.3],
}
SETTINGS = {"plan.shots": 60, "plan.validation_pairs": 20, "settle.time_s": 0.2}
NOISE_MM = 0.010
"""Mean error of distances by the tracker alone: 15/√3 µm a coordinate."""


def beyond_noise_mm(mean_mm):
    return max(mean_mm**2 - NOISE_MM**2, 0.0) ** 0.5


def truth(folder):
    """Geometry of the simulated robot, and the terms of its gears, by name."""
    scenario = load_scenario(str(folder / "cell.yaml"))
    gears, terms = transmission(scenario.robot, scenario.seed), {}
    for arm in range(4):
        for name, size, phase in (
            ("eccentricity", gears.eccentricity[arm], gears.phase_rad[arm]),
            ("ripple", gears.ripple[arm], gears.ripple_phase_rad[arm]),
        ):
            terms[f"arm{arm}.{name}_sin_deg"] = float(np.degrees(size * np.cos(phase)))
            terms[f"arm{arm}.{name}_cos_deg"] = float(-np.degrees(size * np.sin(phase)))
        terms[f"arm{arm}.backlash_deg"] = 0.3 / 60.0
    return true_geometry(scenario.robot, scenario.seed), terms


def test_terms_of_gears_take_most_of_the_error_off(tmp_path, capsys):
    with world_controller(tmp_path, times_as_fast=10) as linuxcnc:
        folder = made_campaign(tmp_path / "campaign", linuxcnc, "par4-prototype", SETTINGS, GEARS)
        change(folder / "robot.yaml", {"ripples_per_turn": 30.0})
        geometry, terms = truth(folder)
        pkmcal, found = Campaign(folder, linuxcnc, capsys), {}

        def validated(way, values):
            as_found = {name: {"value": value} for name, value in values.items()}
            load_although_refused(pkmcal, {"parameters": as_found})
            found[way] = measured()

        def measured():
            only = ("--only", "distances", "--yes", "--force")
            told = pkmcal("validate", "--stage", "after", *only, codes=(0, 1))
            return told["distances_mm"]["mean_abs"]

        pkmcal("plan")
        validated("pkmkins and BACKLASH", geometry | terms)
        assert float(linuxcnc.hal("getp", "ini.2.backlash")) == pytest.approx(0.005)
        validated("geometry alone", geometry)
    with capsys.disabled():
        tell(f"validated on LinuxCNC, mm: {found}")
    today = beyond_noise_mm(found.pop("geometry alone"))
    assert all(beyond_noise_mm(mean_mm) < today / 3.0 for mean_mm in found.values())
