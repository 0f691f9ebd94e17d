"""What a printer's firmware saved becomes observations: heights of its bed, distances on a part."""

from pathlib import Path

import numpy as np
import pytest

from campaigns.errors import ShotsMissing
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


def with_saved(heights, distances=0):
    lines = [
        f"#*# height{n} = 0.0\n#*# height{n}_pos = {n},{n + 1},{n + 2}" for n in range(heights)
    ]
    lines += [
        f"#*# distance{n} = 65\n#*# distance{n}_pos1 = {n},1,2\n#*# distance{n}_pos2 = {n},3,4"
        for n in range(distances)
    ]
    text = "\n".join([SIZES, "#*# [delta_calibrate]", *lines, ""])
    return PrinterConfig.of_text(text, "printer.cfg")


def test_every_third_of_many_is_held_out_and_none_of_few():
    rows = printer_observations(with_saved(heights=7, distances=12))
    assert [row.kind for row in rows] == ["height"] * 7 + ["distance"] * 12
    held_out = [row for row in rows if row.purpose is ShotSet.VALIDATION]
    assert [(row.kind, row.pair) for row in held_out] == [
        ("distance", number) for number in ("2", "5", "8", "11")
    ]
    assert {row.object for row in rows} == {"bed", "part"}


def test_they_are_read_again_from_the_file_that_is_written_of_them():
    printer = with_saved(heights=20, distances=3)
    mechanism = parse_robot(printer.robot_text, "printer.yaml").robot.mechanism
    rows = printer_observations(printer)
    text = observations_text(rows, mechanism)
    again = parse_observations(text, "observations.csv", mechanism, {"bed", "part"})
    for row, read in zip(rows, again, strict=True):
        assert np.array(row.joints) == pytest.approx(np.array(read.joints))
        assert (row.values, row.purpose, row.pair) == (read.values, read.purpose, read.pair)


def test_a_file_in_which_nothing_was_saved_says_how_to_save_it():
    with pytest.raises(ShotsMissing, match=r"printer.cfg holds no heights") as raised:
        printer_observations(PrinterConfig.of_text(SIZES, str(Path("a") / "printer.cfg")))
    assert "SAVE_CONFIG" in raised.value.remedy
