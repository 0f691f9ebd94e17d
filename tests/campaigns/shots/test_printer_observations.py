"""What a printer's firmware saved becomes observations: heights of its bed, distances on a part."""

from pathlib import Path

import numpy as np
import pytest

from campaigns.errors import ShotsInvalid, ShotsMissing
from campaigns.robots.printer_config import PrinterConfig
from campaigns.robots.robot import parse_robot
from campaigns.shots.observations_csv import observations_text, parse_observations
from campaigns.shots.printer_observations import printer_observations
from campaigns.shots.shot_sets import ShotSet

SIZES = """[stepper_a]
position_endstop: 300
arm_length: 290
rotation_distance: 40
microsteps: 16
[stepper_b]
[stepper_c]
[printer]
kinematics: delta
delta_radius: 130
[delta_calibrate]
"""


LOW = 24000
"""Steps from the end stops down to the bed."""


def with_saved(heights, distances=0):
    lines = [
        f"#*# height{n} = 0.0\n#*# height{n}_pos = {LOW + n},{LOW - n},{LOW}"
        for n in range(heights)
    ]
    lines += [
        f"#*# distance{n} = 65\n#*# distance{n}_pos1 = {n},1,2\n#*# distance{n}_pos2 = {n},3,4"
        for n in range(distances)
    ]
    text = "\n".join([SIZES, "#*# [delta_calibrate]", *lines, ""])
    return PrinterConfig.of_text(text, "printer.cfg")


def kinematics(printer):
    return parse_robot(printer.robot_text, "printer.yaml").robot.kinematics


def touching(text=""):
    """A printer whose 12 touches are on a bed, with a part of its file changed afterwards."""
    printer = PrinterConfig.of_text(SIZES, "printer.cfg")
    angles = np.arange(12.0)
    places = np.column_stack([9 * angles * np.cos(angles), 9 * angles * np.sin(angles), 0 * angles])
    steps = kinematics(printer).inverse(places).values_or_raise() / -0.0125
    lines = [
        f"#*# height{n} = 0\n#*# height{n}_pos = {','.join(map(str, row))}"
        for n, row in enumerate(steps.tolist())
    ]
    saved = "\n".join(["", "#*# [delta_calibrate]", *lines, ""])
    return PrinterConfig.of_text(SIZES.replace(*(text or ("", ""))) + saved, "printer.cfg")


def test_touches_by_other_steps_than_those_of_the_file_are_refused():
    right = touching()
    assert len(printer_observations(right, kinematics(right))) == 12
    for change in (("microsteps: 16", "microsteps: 32"), ("distance: 40", "distance: 48")):
        wrong = touching(change)
        with pytest.raises(ShotsInvalid, match="half of the touches") as raised:
            printer_observations(wrong, kinematics(wrong))
        assert "microsteps" in raised.value.remedy


def test_every_third_of_many_is_held_out_and_none_of_few():
    printer = with_saved(heights=7, distances=12)
    rows = printer_observations(printer, kinematics(printer))
    assert [row.kind for row in rows] == ["height"] * 7 + ["distance"] * 12
    held_out = [row for row in rows if row.purpose is ShotSet.VALIDATION]
    assert [(row.kind, row.pair) for row in held_out] == [
        ("distance", number) for number in ("2", "5", "8", "11")
    ]
    assert {row.object for row in rows} == {"bed", "part"}


def test_they_are_read_again_from_the_file_that_is_written_of_them():
    printer = with_saved(heights=20, distances=3)
    mechanism = parse_robot(printer.robot_text, "printer.yaml").robot.mechanism
    rows = printer_observations(printer, kinematics(printer))
    text = observations_text(rows, mechanism)
    again = parse_observations(text, "observations.csv", mechanism, {"bed", "part"})
    for row, read in zip(rows, again, strict=True):
        assert np.array(row.joints) == pytest.approx(np.array(read.joints))
        assert (row.values, row.purpose, row.pair) == (read.values, read.purpose, read.pair)


def test_a_file_in_which_nothing_was_saved_says_how_to_save_it():
    printer = PrinterConfig.of_text(SIZES, str(Path("a") / "printer.cfg"))
    with pytest.raises(ShotsMissing, match=r"printer.cfg holds no heights") as raised:
        printer_observations(printer, kinematics(printer))
    assert "SAVE_CONFIG" in raised.value.remedy
