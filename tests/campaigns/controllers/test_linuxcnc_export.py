"""LinuxCNC's HAL file: full doubles, whose it is, and what is refused."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from par4_space import SPACE, with_values

from campaigns.controllers import linuxcnc_export
from campaigns.errors import ConfigInvalid, OutputExists
from campaigns.kinematics.catalog import MECHANISMS
from campaigns.kinematics.parameters import Role
from campaigns.robots.robot import find_robot

NOMINAL = find_robot("par4-prototype").robot
WHOSE = linuxcnc_export.RobotIdentity("PAR4-7", NOMINAL)
TILTED = {"arm1.axis_tilt_deg": 0.02, "arm2.parallelogram_skew_deg": -0.01}
lengths = st.floats(1e-3, 1e5)
anything = st.floats(-1e5, 1e5)
geometries = st.fixed_dictionaries(
    {name: lengths if name.endswith(("arm_mm", "plate_mm")) else anything for name in SPACE.names}
)


def robot_with(**changes):
    flat = NOMINAL.parameters | {name.replace("__", "."): v for name, v in changes.items()}
    return WHOSE.having(flat, "changed")


def text_of(robot=NOMINAL):
    return linuxcnc_export.hal_text(robot, "PAR4-7")


@given(geometries)
def test_every_double_is_read_as_it_was_written(geometry):
    robot = WHOSE.having(geometry, "drawn")
    assert linuxcnc_export.parse_hal(text_of(robot), "calib.hal", WHOSE).parameters == geometry


def test_file_is_one_setting_a_parameter_and_the_plates_drawing():
    lines = [line for line in text_of().splitlines() if not line.startswith("#")]
    drawing = linuxcnc_export.drawing_flat(NOMINAL.mechanism)
    assert lines[0] == "setp pkmkins.arm0.x_mm -172.5"
    assert lines[28] == "setp pkmkins.plate_mm 100.0"
    assert lines[29:] == [f"setp pkmkins.{name} {value!r}" for name, value in drawing.items()]
    tilted = text_of(with_values(NOMINAL, TILTED))
    assert "setp pkmkins.arm1.axis_tilt_deg 0.02\n" in tilted


@pytest.mark.parametrize("change", ["20.5", None])
def test_a_plate_drawn_otherwise_is_refused_where_it_tilts(change):
    tilted = with_values(NOMINAL, TILTED)
    text, line = text_of(tilted), "setp pkmkins.reflector_x_mm 20.0\n"
    wrong = text.replace(line, "" if change is None else line.replace("20.0", change))
    assert wrong != text
    with pytest.raises(ConfigInvalid, match=r"reflector_x_mm is (20\.5|missing), .* it is 20"):
        linuxcnc_export.parse_hal(wrong, "calib.hal", WHOSE)


def test_backlashes_are_comments_for_the_bridge_and_ripples_come_with_their_rate():
    gears = {"arm1.backlash_deg": 0.005, "arm2.ripple_sin_deg": 0.003}
    robot = with_values(NOMINAL, gears | {"ripples_per_turn": 30.0})
    text = linuxcnc_export.hal_text(robot, "PAR4-7")
    assert "\n# setp ini.1.backlash 0.005\n" in text
    assert "setp pkmkins.arm2.ripple_sin_deg 0.003\n" in text
    assert "setp pkmkins.ripples_per_turn 30.0\n" in text
    assert "setp pkmkins.arm1.backlash" not in text
    found = linuxcnc_export.parse_hal(text, "calib.hal", WHOSE)
    assert (found.parameters, found.mechanism.rate) == (robot.parameters, 30.0)
    with pytest.raises(ConfigInvalid, match="sha256 is not that of its parameters"):
        linuxcnc_export.parse_hal(text.replace("turn 30.0", "turn 31.0"), "calib.hal", WHOSE)
    before = text.replace("# setp ini.1.backlash 0.005", "# [JOINT_1]BACKLASH = 0.005")
    assert before != text
    assert linuxcnc_export.parse_hal(before, "calib.hal", WHOSE).parameters == found.parameters


@pytest.mark.parametrize("name", MECHANISMS)
def test_every_mechanism_is_written_and_read(name):
    nominal = find_robot("par4-prototype" if name == "par4" else name).robot
    whose = linuxcnc_export.RobotIdentity("SN-1", nominal)
    names = nominal.mechanism.parameters.select(Role.EXTENSION)
    extended = {name: 0.01 * (place + 1) for place, name in enumerate(names)}
    for robot in (nominal, with_values(nominal, extended)):
        found = linuxcnc_export.parse_hal(
            linuxcnc_export.hal_text(robot, "SN-1"), "calib.hal", whose
        )
        assert dict(found.parameters) == dict(robot.parameters)


def test_a_file_of_another_mechanism_or_of_nobody_is_refused():
    whose = linuxcnc_export.RobotIdentity("PAR4-7", find_robot("delta").robot)
    with pytest.raises(ConfigInvalid, match=r"arm3\.x_mm is no pin of pkmkins for a delta"):
        linuxcnc_export.parse_hal(text_of(), "calib.hal", whose)
    text = text_of().replace("# robot: PAR4-7\n", "")
    with pytest.raises(ConfigInvalid, match="nobody said") as error:
        linuxcnc_export.parse_hal(text, "calib.hal", WHOSE)
    assert "# robot: PAR4-7" in error.value.remedy


def test_a_file_that_was_written_for_par4kins_is_still_read():
    text = text_of().replace("setp pkmkins.", "setp par4kins.")
    assert dict(linuxcnc_export.parse_hal(text, "calib.hal", WHOSE).parameters) == dict(
        NOMINAL.parameters
    )


def test_heading_says_whose_it_is_and_where_it_comes_from_in_lines_that_halcmd_takes():
    provenance = {"campaign": "cell-3", "shots": 120, "unseen_mm": {"after": 0.02}}
    text = text_of(replace(NOMINAL, provenance=provenance))
    assert "# robot: PAR4-7" in text
    assert f"# sha256: {NOMINAL.digest()}" in text
    assert '# campaign: "cell-3"' in text
    assert '# unseen_mm: {"after": 0.02}' in text
    text = text_of(replace(NOMINAL, provenance={"reasons": "because " * 100}))
    assert max(map(len, text.splitlines())) < 200


def test_file_changed_by_hand_is_refused_until_it_says_so():
    text = text_of().replace("plate_mm 100.0", "plate_mm 100.5")
    with pytest.raises(ConfigInvalid, match="sha256") as error:
        linuxcnc_export.parse_hal(text, "calib.hal", WHOSE)
    assert "delete the line sha256" in error.value.remedy
    without = "\n".join(line for line in text.splitlines() if "sha256" not in line)
    assert linuxcnc_export.parse_hal(without, "calib.hal", WHOSE).parameters["plate_mm"] == 100.5


@pytest.mark.parametrize(
    ("old", "new", "problem"),
    [
        ("setp pkmkins.plate_mm 100.0\n", "", "plate_mm is missing"),
        ("setp pkmkins.plate_mm", "setp rotarydeltakins.shinlength", "calib.hal:.*no pin of"),
        ("setp pkmkins.plate_mm", "setp pkmkins.plate", "no pin of pkmkins"),
        ("plate_mm 100.0", "plate_mm 100,0", "'100,0' is no number"),
        ("plate_mm 100.0", "plate_mm nan", "plate_mm is nan"),
        ("plate_mm 100.0", "plate_mm -100.0", "a length of -100 mm"),
        ("setp pkmkins.plate_mm 100.0", "loadrt pkmkins", "no line `setp PIN VALUE`"),
        ("setp pkmkins.plate_mm", "setp pkmkins.arm0.x_mm", "arm0.x_mm is set twice"),
    ],
)
def test_file_that_is_not_all_and_only_the_parameters_is_refused(old, new, problem):
    text = text_of().replace(old, new)
    assert text != text_of()
    with pytest.raises(ConfigInvalid, match=problem):
        linuxcnc_export.parse_hal(text, "calib.hal", WHOSE)


def test_export_does_not_overwrite_unasked(tmp_path):
    path = tmp_path / "calib.hal"
    linuxcnc_export.write_hal(path, NOMINAL, "PAR4-7", overwrite=False)
    with pytest.raises(OutputExists):
        linuxcnc_export.write_hal(path, robot_with(plate_mm=101.0), "PAR4-7", overwrite=False)
    linuxcnc_export.write_hal(path, robot_with(plate_mm=101.0), "PAR4-7", overwrite=True)
    assert "plate_mm 101.0" in path.read_text()


def test_another_robots_file_is_neither_read_nor_replaced(tmp_path):
    path = tmp_path / "calib.hal"
    linuxcnc_export.write_hal(path, NOMINAL, "PAR4-8", overwrite=False)
    file = linuxcnc_export.CalibrationFile(path, WHOSE)
    with pytest.raises(ConfigInvalid, match="of robot 'PAR4-8'"):
        file.read()
    with pytest.raises(ConfigInvalid, match="of robot 'PAR4-8'"):
        file.write(dict(NOMINAL.parameters))
    assert "PAR4-8" in path.read_text()


def test_held_parameters_are_the_nominal_ones_until_others_are_written(tmp_path):
    file = linuxcnc_export.CalibrationFile(tmp_path / "active.hal", WHOSE)
    assert file.read() == dict(NOMINAL.parameters)
    file.write(dict(robot_with(plate_mm=101.0).parameters))
    assert file.read()["plate_mm"] == 101.0


def test_incomplete_set_is_never_written(tmp_path):
    with pytest.raises(ConfigInvalid, match="missing"):
        linuxcnc_export.CalibrationFile(tmp_path / "calib.hal", WHOSE).write({"plate_mm": 100.0})
    assert list(tmp_path.iterdir()) == []
