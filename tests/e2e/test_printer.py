"""A Delta printer from its firmware's file to its firmware's values, by the commands."""

import math

import numpy as np
import pytest
from printers import RADIUS_MM, ROD_MM, Printer, rings

TOP_MM = 600.0
"""Height of the carriages at their end stops."""
MM_PER_STEP = 40.0 / (200.0 * 16.0)
SIZES = f"""\
[printer]
kinematics: delta
delta_radius: {RADIUS_MM}
print_radius: 110
[stepper_a]
position_endstop: {TOP_MM - math.sqrt(ROD_MM**2 - RADIUS_MM**2):.6f}
arm_length: {ROD_MM}
rotation_distance: 40
microsteps: 16
[stepper_b]
[stepper_c]
[delta_calibrate]
radius: 100
"""


@pytest.fixture(scope="module")
def drawn():
    return Printer(3)


@pytest.fixture
def file(drawn, tmp_path):
    """What the firmware saved after 37 touches."""
    path = tmp_path / "printer.cfg"
    steps = (TOP_MM - drawn.touched(rings(100.0, 6))) / MM_PER_STEP
    lines = [
        f"#*# height{n} = 0.0\n#*# height{n}_pos = {','.join(f'{count:.3f}' for count in row)}"
        for n, row in enumerate(steps)
    ]
    path.write_text("\n".join([SIZES, "#*# [delta_calibrate]", *lines, ""]), encoding="utf-8")
    return path


def heights(drawn, settings, places):
    """Real heights of the nozzle above the bed where the firmware wants 0, (M,)."""
    radius, sides = settings["printer"]["delta_radius"], "abc"
    arms, angles, stops = (
        np.array([settings[f"stepper_{side}"][key] for side in sides])
        for key in ("arm_length", "angle", "position_endstop")
    )
    towers = radius * np.column_stack([np.cos(np.radians(angles)), np.sin(np.radians(angles))])
    away = ((places[:, None] - towers) ** 2).sum(axis=2)
    carriages = np.sqrt(arms**2 - away)
    joints = TOP_MM + carriages - (stops + np.sqrt(arms**2 - radius**2))
    real = drawn.positions(joints)
    return real[:, 2] - real[:, :2] @ drawn.slopes


def read(text):
    settings = {}
    for line in text.splitlines():
        if line.startswith("["):
            section = settings.setdefault(line.strip("[]"), {})
        elif not line.startswith("#"):
            key, value = line.split(": ")
            section[key] = value if key == "kinematics" else float(value)
    return settings


def test_a_first_layer_is_level_by_the_values_of_four_commands(pkmcal, drawn, file):
    folder = file.parent / "printer"
    made = pkmcal("new", folder, "--offline", "--robot", file)
    assert (made.code, f"next: pkmcal import {folder} {file}" in made.err) == (0, True)
    imported = pkmcal("import", folder, file)
    assert imported.code == 0
    assert "37 of bed (height)" in imported.out
    assert f"next: pkmcal identify {folder} --for flat" in imported.err
    identified = pkmcal("identify", folder, "--for", "flat")
    assert (identified.code, "verdict: pass" in identified.out) == (0, True)
    assert f"next: pkmcal export {folder} --format klipper" in identified.err
    exported = pkmcal("export", folder, "--format", "klipper")
    assert exported.code == 0
    assert "z = 0 is the bed" in exported.err
    assert f"next: pkmcal report {folder}" in exported.err
    places = rings(95.0, 5)
    nominal = {"printer": {"delta_radius": RADIUS_MM}} | {
        f"stepper_{side}": {
            "arm_length": ROD_MM,
            "angle": angle,
            "position_endstop": TOP_MM - math.sqrt(ROD_MM**2 - RADIUS_MM**2),
        }
        for side, angle in zip("abc", (210.0, 330.0, 90.0), strict=True)
    }
    before = heights(drawn, nominal, places)
    after = heights(drawn, read((folder / "klipper.cfg").read_text(encoding="utf-8")), places)
    assert np.ptp(before) > 0.5
    assert np.abs(after).max() < 0.1
    assert after.std() < 0.03


def test_a_file_without_touches_and_another_robot_are_refused(pkmcal, file, tmp_path):
    bare = tmp_path / "bare.cfg"
    bare.write_text(SIZES, encoding="utf-8")
    folder = tmp_path / "bare"
    assert pkmcal("new", folder, "--offline", "--robot", bare).code == 0
    refused = pkmcal("import", folder, bare)
    assert refused.code != 0
    assert "SAVE_CONFIG" in refused.err
    other = tmp_path / "other"
    assert pkmcal("new", other, "--offline", "--robot", "delta").code == 0
    refused = pkmcal("import", other, file)
    assert refused.code != 0
    assert "unforeseen" not in refused.err
