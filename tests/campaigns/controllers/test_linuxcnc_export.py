"""LinuxCNC's HAL file: full doubles, and whose they are; parameters that were typed by hand."""

from dataclasses import replace

import numpy as np
import pytest
from hal_files import parameters_of
from par4_space import with_values

from campaigns.api import sample_workspace
from campaigns.controllers import linuxcnc_export
from campaigns.controllers.active_kinematics import FILE_BEFORE, HeldParameters
from campaigns.controllers.controller_state import KnownSets
from campaigns.errors import ConfigInvalid
from campaigns.kinematics.catalog import FAMILY
from campaigns.kinematics.parameters import Role
from campaigns.robots.robot import find_robot, parse_robot

DOCUMENT = find_robot("par4-prototype")
NOMINAL = DOCUMENT.robot
TILTED = {"arm1.axis_tilt_deg": 0.02, "arm2.parallelogram_skew_deg": -0.01}


def text_of(robot=NOMINAL):
    return linuxcnc_export.hal_text(robot, "PAR4-7")


def test_file_is_one_setting_a_parameter_and_the_plates_drawing():
    lines = [line for line in text_of().splitlines() if not line.startswith("#")]
    drawing = linuxcnc_export.drawing_pins(NOMINAL.mechanism)
    assert lines[0] == "setp pkmkins.arm0.x_mm -172.5"
    assert lines[28] == "setp pkmkins.plate_mm 100.0"
    assert lines[29:] == [f"setp {pin} {value!r}" for pin, value in drawing.items()]
    assert "setp pkmkins.arm1.axis_tilt_deg 0.02\n" in text_of(with_values(NOMINAL, TILTED))


def test_backlashes_are_comments_for_the_bridge_and_ripples_come_with_their_rate():
    gears = {"arm1.backlash_deg": 0.005, "arm2.ripple_sin_deg": 0.003}
    robot = with_values(NOMINAL, gears | {"ripples_per_turn": 30.0})
    text = text_of(robot)
    assert "\n# setp ini.1.backlash 0.005\n" in text
    assert "setp pkmkins.ripples_per_turn 30.0\n" in text
    assert "setp pkmkins.arm1.backlash" not in text
    assert parameters_of(text, NOMINAL.mechanism) == dict(robot.parameters)


def test_ripples_of_unlike_rates_are_refused_for_pkmkins_has_one():
    gears = {"arm0.ripple_sin_deg": 0.002, "arm2.ripple_sin_deg": 0.003}
    alone = with_values(NOMINAL, gears | {f"arm{arm}.ripples_per_turn": 30.0 for arm in (0, 2)})
    assert "setp pkmkins.ripples_per_turn 30.0\n" in text_of(alone)
    rates = {"arm0.ripples_per_turn": 30.0, "arm2.ripples_per_turn": 50.0}
    with pytest.raises(ConfigInvalid, match=r"arm0\.ripples_per_turn is 30, but .* single joints"):
        text_of(with_values(NOMINAL, gears | rates))


@pytest.mark.parametrize("name", ["hexapod", "five-bar"])
def test_a_mechanism_that_pkmkins_does_not_compute_is_refused(name):
    with pytest.raises(ConfigInvalid, match=f"pkmkins.* computes no {name}") as raised:
        text_of(find_robot(name).robot)
    assert "pkmcal correct" in raised.value.remedy


@pytest.mark.parametrize("name", FAMILY)
def test_every_mechanism_is_written_in_full_doubles(name):
    nominal = find_robot("par4-prototype" if name == "par4" else name).robot
    names = nominal.mechanism.parameters.select(Role.EXTENSION)
    extended = {name: 0.1 / 3.0 * (place + 1) for place, name in enumerate(names)}
    for robot in (nominal, with_values(nominal, extended)):
        assert parameters_of(text_of(robot), nominal.mechanism) == dict(robot.parameters)


@pytest.mark.parametrize("name", ["par4-prototype", "linear-delta"])
def test_file_holds_the_fitted_places_on_the_plate(name):
    """A robot of the pins' sums alone, without deviations, stands where the fitted one does."""
    nominal = find_robot(name).robot
    table, rng = nominal.mechanism.parameters, np.random.default_rng(4)
    tilting = {n: rng.normal(0.0, 0.1) for n in table.select(group="rods")}
    on_plate = (*table.select(group="plate_joints"), *table.select(group="reflector"))
    fitted = with_values(nominal, tilting | {n: rng.normal(0.0, 20.0) for n in on_plate})
    text = text_of(fitted)
    pins = {line.split()[1]: float(line.split()[2]) for line in text.splitlines() if line[0] == "s"}
    joints_mm = [
        [pins[f"pkmkins.arm{arm}.plate_{c}_mm"] + pins[f"pkmkins.arm{arm}.plate_joint_{c}_mm"]
         for c in "xyz"]
        for arm in range(table.arms)
    ]  # fmt: skip
    reflector_mm = [
        pins[f"pkmkins.reflector_{c}_mm"] + pins[f"pkmkins.fitted.reflector_{c}_mm"] for c in "xyz"
    ]
    plate = replace(
        nominal.mechanism.plate,
        joints_mm=tuple(map(tuple, joints_mm)), reflector_mm=tuple(reflector_mm),
    )  # fmt: skip
    summed = with_values(replace(nominal, mechanism=nominal.mechanism.with_plate(plate)), tilting)
    poses = sample_workspace(nominal, 20)
    joints = nominal.kinematics.inverse(poses).values_or_raise()
    theirs, ours, drawn = (
        robot.kinematics.forward(joints, poses).values_or_raise()
        for robot in (summed, fitted, with_values(nominal, tilting))
    )
    assert np.abs(theirs - ours).max() < 1e-9
    assert np.abs(drawn - ours).max() > 0.02


def test_reflector_on_another_part_is_no_pin_of_the_controlled_point():
    on_half_2 = parse_robot(f"{DOCUMENT.document.text}reflector_half: 2\n", "half.yaml").robot
    fitted = {"reflector_x_mm": 12.0, "arm1.plate_joint_z_mm": 2.0}
    text = text_of(with_values(on_half_2, TILTED | fitted))
    assert "pkmkins.fitted.reflector" not in text
    assert "setp pkmkins.arm1.plate_joint_z_mm 2.0\n" in text
    assert "setp pkmkins.fitted.reflector_x_mm 12.0\n" in text_of(with_values(NOMINAL, fitted))


def test_set_without_that_place_is_known_as_the_whole_one():
    on_half_2 = parse_robot(f"{DOCUMENT.document.text}reflector_half: 2\n", "half.yaml").robot
    whole = with_values(on_half_2, TILTED | {"reflector_x_mm": 12.0})
    held = dict(whole.for_controller)
    assert dict(whole.parameters) == held | {"reflector_x_mm": 12.0}
    sets = (NOMINAL.parameters, whole.parameters)
    assert KnownSets(on_half_2, {}, {}, sets).match(held) is whole.parameters
    assert KnownSets(NOMINAL, {}, {}, sets).match(held).digest() != whole.digest()
    assert NOMINAL.for_controller is NOMINAL.parameters


def test_heading_says_whose_it_is_and_where_it_comes_from_in_lines_that_halcmd_takes():
    provenance = {"campaign": "cell-3", "shots": 120, "unseen_mm": {"after": 0.02}}
    text = text_of(replace(NOMINAL, provenance=provenance))
    for line in ("robot: PAR4-7", f"sha256: {NOMINAL.digest()}", 'campaign: "cell-3"'):
        assert f"# {line}\n" in text
    text = text_of(replace(NOMINAL, provenance={"reasons": "because " * 100}))
    assert max(map(len, text.splitlines())) < 200


def test_typed_parameters_are_the_nominal_ones_until_others_are_written(tmp_path):
    held = HeldParameters(tmp_path, DOCUMENT)
    assert held.read() == NOMINAL.parameters
    held.write(NOMINAL.parameters | TILTED | {"plate_mm": 101.0})
    assert held.read() == NOMINAL.parameters | TILTED | {"plate_mm": 101.0}
    with pytest.raises(ConfigInvalid, match="missing"):
        held.write({"plate_mm": 100.0})
    assert held.read()["plate_mm"] == 101.0


def test_typed_parameters_of_an_earlier_version_are_not_taken_for_nominal(tmp_path):
    (tmp_path / FILE_BEFORE).write_text("setp pkmkins.plate_mm 101.0\n")
    with pytest.raises(ConfigInvalid, match="an earlier version kept") as error:
        HeldParameters(tmp_path, DOCUMENT).read()
    assert "by-hand-active.yaml" in error.value.remedy
