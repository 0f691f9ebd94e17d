"""The full model on the real LinuxCNC: a robot of unequal rods and tilted axes, moved by a
kinematics that computes how they tilt the plate.
"""

import pytest
from linuxcnc_bench import NEEDS_LINUXCNC, world_controller
from linuxcnc_campaign import Campaign, made_campaign, tell

from campaigns.campaign import open_campaign
from campaigns.robots.robot import compensated, read_robot, write_new_robot

pytestmark = [*NEEDS_LINUXCNC, pytest.mark.timeout(500), pytest.mark.long]

IMPERFECT = {"robot.tolerances.rod_mm": 0.05, "robot.tolerances.axis_tilt_mrad": 0.5}
SETTINGS = {"plan.shots": 120, "plan.validation_pairs": 20, "settle.time_s": 0.05}
BESIDE_GEOMETRY = ("azimuths", "rods", "axes", "bars", "eccentricity", "ratio", "backlash", "sag")
SAME_FACTOR = 1.5


def load_all_the_same(pkmcal, found):
    """Load what was identified although its verdict does not let it pass."""
    nominal = open_campaign(pkmcal.folder).nominal
    flat = {name: each["value"] for name, each in found["parameters"].items()}
    path = pkmcal.folder / "standard.yaml"
    path.unlink(missing_ok=True)
    write_new_robot(path, compensated(nominal, "standard", flat))
    pkmcal.load("--robot", str(path), "--force")


def test_loaded_full_model_takes_off_distances_what_it_took_off_unseen_ones(tmp_path, capsys):
    with world_controller(tmp_path, times_as_fast=10) as linuxcnc:
        folder = made_campaign(
            tmp_path / "campaign", linuxcnc, "par4-prototype", SETTINGS, IMPERFECT
        )
        pkmcal = Campaign(folder, linuxcnc, capsys)
        pkmcal("plan")
        before_mm = pkmcal.validated("before")["mean_abs"]
        pkmcal("run", "--yes")

        held = [word for group in BESIDE_GEOMETRY for word in ("--fix", group)]
        standard = pkmcal("identify", *held, codes=(0, 1))
        load_all_the_same(pkmcal, standard)
        standard_mm = pkmcal.validated("after")["mean_abs"]

        full = pkmcal("identify")
        assert full["verdict"] == "pass"
        pkmcal("export")
        pkmcal.load()
        full_mm = pkmcal.validated("after")["mean_abs"]
        calib = (linuxcnc.config / "calib.hal").read_text()

    unseen = {name: found["unseen_mm"] for name, found in (("22", standard), ("full", full))}
    foreseen_mm = unseen["full"]["after"]["mean_abs"]
    from_nominal = unseen["full"]["before"]["mean_abs"] / foreseen_mm
    from_22 = unseen["22"]["after"]["mean_abs"] / foreseen_mm
    with capsys.disabled():
        for name, each in unseen.items():
            means_mm = [each[when]["mean_abs"] for when in ("before", "after")]
            tell(f"hold-out pairs, {name}: mean error before and after {means_mm} mm")
        tell(f"validated on LinuxCNC: {before_mm}, by the 22 {standard_mm}, full {full_mm} mm")
    loaded = read_robot(folder / "robot-compensated.yaml").robot
    assert len(loaded.parameters.extended_by) > 6
    as_pins = [name for name in loaded.parameters.extended_by if "backlash" not in name]
    assert all(f"setp pkmkins.{name} " in calib for name in as_pins)
    assert "setp pkmkins.reflector_x_mm 20.0" in calib
    assert full_mm < standard_mm
    assert from_nominal / SAME_FACTOR < before_mm / full_mm < from_nominal * SAME_FACTOR
    assert from_22 / SAME_FACTOR < standard_mm / full_mm < from_22 * SAME_FACTOR
