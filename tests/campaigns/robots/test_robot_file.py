"""Robot files: read, checked, compensated, written."""

import math

import numpy as np
import pytest
from family_cases import PAR4_REFERENCE, flat_in
from hypothesis import given
from hypothesis import strategies as st
from par4_space import AXIS_TILT_NAMES, SPACE
from refusals import refusal

from campaigns.errors import ConfigInvalid
from campaigns.files.yaml_file import yaml_text
from campaigns.fit.error_model import ErrorModel
from campaigns.fit.error_sources import TRACKER_SOURCES
from campaigns.kinematics.catalog import PAR4
from campaigns.kinematics.parameters import Parameters, Role
from campaigns.robots.robot import (
    RobotFile,
    compensated,
    find_robot,
    parse_robot,
    read_robot,
    write_new_robot,
)

PROTOTYPE = find_robot("par4-prototype")
LINE_OF_ARM_0 = 18
LINE_OF_ARM_2 = 20
LAST_LINE = "  forearm_swing_deg: 45.0\n"
TILTS = {"arm0.axis_tilt_deg": 0.03, "arm3.axis_tilt_deg": -0.02}
DIGESTS = {
    "delta": ("56dbe97438f7e92c", "575da048a86c982d"),
    "h4": ("22eb3c6826841239", "a7a1ae0190685b8b"),
    "i4l": ("6711755e768466ee", "b88ea5dc03b9cf24"),
    "i4r": ("6a178fbbd804dd3e", "77775310f8305908"),
    "linear-delta": ("6996612ec06c5875", "bb352505acc1ca48"),
    "par4-prototype": ("169ab5bb17abe80a", "674adb92234fdb78"),
    "par4-table1": ("f6c8eb5cc6af5de5", "5ba2adb27bf2a2aa"),
}
"""First digits of sha256: of the shipped geometry, and of a changed one with imperfect parts."""


def written(folder, text):
    path = folder / "robot.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def complaint(folder, old, new):
    """What reading says of the prototype's file with one passage replaced."""
    assert old in PROTOTYPE.document.text
    path = written(folder, PROTOTYPE.document.text.replace(old, new, 1))
    return refusal(ConfigInvalid, read_robot, path, begins=f"{path}:").removeprefix(f"{path}:")


UNCERTAINTY = {"arm0.joint_offset_deg": 0.002, "arm1.x_mm": 0.05}
PROVENANCE = {"campaign": "spring", "shots": 120, "before_mm": {"max_abs": 7.25}}


def changed(geometry=PROTOTYPE.robot.parameters, of=PROTOTYPE, std=None, provenance=PROVENANCE):
    """A document with other parameters, their σ and where they come from."""
    parameters = Parameters.of(PAR4.parameters, geometry, UNCERTAINTY if std is None else std)
    return compensated(of, "par4-prototype compensated", parameters, provenance)


def test_a_home_out_of_reach_is_told():
    text = find_robot("five-bar").document.text.replace("[120.0, 380.0]", "[120.0, 1380.0]")
    with pytest.raises(ConfigInvalid, match="five-bar: out of reach at home"):
        parse_robot(text, "far.yaml")


def test_shipped_robots_are_those_of_reference_and_paper():
    nominal = PAR4_REFERENCE["cases"]["nominal"]
    assert PROTOTYPE.robot.parameters == flat_in(nominal["geometry"])
    limits = PROTOTYPE.robot.limits
    assert limits.joint == (math.radians(-45.0), math.radians(90.0))
    assert limits.task == (None, None, None, (math.radians(-45.0), math.radians(45.0)))
    assert limits.forearm_swing_rad == math.radians(45.0)
    flat = find_robot("par4-table1").robot.parameters
    printed_rule = [45.0 + (3 - arm) * 90.0 for arm in range(4)]
    assert [flat[f"arm{arm}.azimuth_deg"] for arm in range(4)] == printed_rule
    assert [flat[f"arm{arm}.forearm_mm"] for arm in range(4)] == [350.0] * 4


def test_robot_is_found_by_path_and_another_named(tmp_path):
    with pytest.raises(ConfigInvalid, match="there is no such file"):
        read_robot(tmp_path / "robot.yaml")
    path = written(tmp_path, PROTOTYPE.document.text)
    assert find_robot(str(path)).robot == PROTOTYPE.robot
    with pytest.raises(ConfigInvalid, match="did you mean par4-prototype") as caught:
        find_robot("par4-protype")
    assert "par4-prototype, par4-table1" in str(caught.value)


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("arm_mm: 350.0", "arm_mm: -350.0", 18, "arms[0].arm_mm is -350.0, must be above 0"),
        ("arm_mm: 350.0", "arm_mm: .nan", 18, "must be a finite number"),
        ("arm_mm: 350.0", "arm_mm: 350,5", 18, "write a decimal point, not a comma"),
        ("arm_mm: 350.0, ", "", 18, "geometry.arms[0].arm_mm is missing"),
        ("forearm_mm: 700.0", "forearm_m: 0.7", 18, "write forearm_mm, with the value in mm"),
        ("    - {x_mm: -172.5, y_mm: 222.5", "    # {", 15, "geometry.arms[3] is missing"),
        ("[-45.0, 90.0]", "[90, -45]", 26, "the lowest must be below the highest"),
        ("mechanism: par4", "mechanism: octopod", 12, "is \"octopod\", must be 'par4', 'h4', "),
        ("mechanism: par4", "mechanism: delta", 23, "geometry.plate_mm is not a known key"),
        ("robot/1", "robot/2", 11, "a newer pkmcal wrote the file"),
        ("robot/1", "campaign/1", 11, "give a pkmcal/robot file here"),
        (LAST_LINE, f"{LAST_LINE}uncertainty: {{arm0.x: 1.0}}", 30, "write arm0.x_mm"),
        (LAST_LINE, f"{LAST_LINE}provenance: {{a: [.nan]}}", 30, "not finite"),
        (LAST_LINE, f"{LAST_LINE}tolerances: {{rod_deg: 0.05}}", 30, "did you mean rods_deg?"),
        (LAST_LINE, f"{LAST_LINE}tolerances: {{rods_deg: 0.0}}", 30, "is 0, must be above 0"),
        ("arm_mm: 350.0", "axis_tilt_deg: 11.0, arm_mm: 350.0", 18, "11.0, must be at most 10"),
    ],
)
def test_wrong_file_is_answered_with_line_key_value_and_remedy(tmp_path, old, new, line, words):
    said = complaint(tmp_path, old, new)
    assert said.startswith(f"{line}: ")
    assert words in said
    assert " → " in said


def test_digest_tells_doubles_and_axis_tilts_apart_but_not_minus_zero():
    flat, digest = PROTOTYPE.robot.parameters, PROTOTYPE.robot.digest()
    for changes, is_equal in (
        ({"arm2.arm_mm": math.nextafter(flat["arm2.arm_mm"], math.inf)}, False),
        ({"arm1.axis_tilt_deg": 0.03}, False),
        ({"arm0.z_mm": -0.0}, True),
    ):
        robot = RobotFile.of(PAR4, flat | changes, name="x", limits=PROTOTYPE.robot.limits)
        assert (robot.digest() == digest) == is_equal, changes


def test_changed_geometry_under_an_old_digest_is_refused_naming_both(tmp_path):
    text = changed().document.text.replace("plate_mm: 100.0", "plate_mm: 100.5")
    with pytest.raises(
        ConfigInvalid, match=f"sha256 is {PROTOTYPE.robot.digest()}, but of"
    ) as said:
        read_robot(written(tmp_path, text))
    assert "restore the file, or delete the line" in said.value.remedy


@pytest.mark.parametrize(
    ("flat", "words"),
    [
        ({"plate_mm": 1.0}, "arm0.x_mm is missing"),
        (PROTOTYPE.robot.parameters | {"arm4.x_mm": 1.0}, "arm4.x_mm is not a parameter"),
        (PROTOTYPE.robot.parameters | {"plate_mm": math.nan}, "plate_mm is nan"),
    ],
)
def test_parameters_that_are_not_the_29_make_no_robot(flat, words):
    with pytest.raises(ConfigInvalid, match=words):
        RobotFile.of(PAR4, flat, name="x", limits=PROTOTYPE.robot.limits)


def test_compensated_file_keeps_the_comments_and_holds_uncertainty_and_origin(tmp_path):
    geometry = PROTOTYPE.robot.parameters | {"arm1.x_mm": 171.25}
    path = tmp_path / "compensated.yaml"
    write_new_robot(path, changed(geometry))
    before = PROTOTYPE.document.text.splitlines()
    after = path.read_text(encoding="utf-8").splitlines()
    differing = [(old, new) for old, new in zip(before, after, strict=False) if old != new]
    assert differing == [
        ("name: par4-prototype", "name: par4-prototype compensated"),
        (before[LINE_OF_ARM_0], before[LINE_OF_ARM_0].replace("172.5", "171.25")),
    ]
    robot = read_robot(path).robot
    assert robot.parameters.std == UNCERTAINTY
    assert robot.provenance == PROVENANCE
    assert f"sha256: {robot.digest()}" in after


def tilted(**changes):
    return changed(PROTOTYPE.robot.parameters | TILTS, **changes)


def test_axis_tilts_are_written_where_there_are_any_and_read_back(tmp_path):
    path = tmp_path / "tilted.yaml"
    write_new_robot(path, tilted(std={"arm0.axis_tilt_deg": 0.01}))
    robot = read_robot(path).robot
    assert path.read_text(encoding="utf-8").count("axis_tilt_deg: ") == 3
    assert robot.parameters == PROTOTYPE.robot.parameters | TILTS
    assert robot.parameters.std == {"arm0.axis_tilt_deg": 0.01}
    assert robot.is_extended
    tilts_rad = robot.kinematics.p[SPACE.places(AXIS_TILT_NAMES)]
    assert tilts_rad.tolist() == [math.radians(0.03), 0.0, 0.0, math.radians(-0.02)]


@pytest.mark.parametrize("name", DIGESTS)
def test_digests_of_every_shipped_robot_are_as_ever(name):
    robot = find_robot(name).robot
    values, table = robot.parameters, robot.mechanism.parameters
    tilts = [
        n
        for n in table.select(Role.EXTENSION)
        if n not in (*table.select(group="bars"), *table.select(group="plate_joints"))
    ]
    tilts = [name for name in tilts if table[name].arm is not None]
    other = {each: value + 0.1 * (i + 1) / 7 for i, (each, value) in enumerate(values.items())}
    other |= {each: 0.01 * (i + 1) / 3 for i, each in enumerate(tilts)}
    made = RobotFile.of(robot.mechanism, other, name="made", limits=robot.limits)
    assert (robot.digest()[:16], made.digest()[:16]) == DIGESTS[name]


def test_a_controller_is_told_29_parameters_or_why_not():
    lacking = PROTOTYPE.robot.mechanism.parameters.select(Role.EXTENSION)
    PROTOTYPE.robot.require_known(lacking, "identify again")
    tilted().robot.require_known((), "")
    with pytest.raises(ConfigInvalid) as caught:
        tilted().robot.require_known(lacking, "identify again")
    assert str(caught.value) == (
        "par4-prototype compensated: arm0.axis_tilt_deg is 0.03, but the controller's kinematics "
        "has no axis tilts → identify again"
    )


def test_what_a_controller_lacks_of_rates_are_those_of_single_joints():
    document = rated("[50, 0, 80, 0]")
    with pytest.raises(ConfigInvalid) as caught:
        document.robot.require_known(SPACE.rates, "correct targets")
    assert str(caught.value) == (
        "par4-prototype: arm0.ripples_per_turn is 50, but the controller's kinematics has no "
        "ripples_per_turn of single joints → correct targets"
    )
    assert document.robot.parameters.extended_by[-2:] == (
        "arm0.ripples_per_turn",
        "arm2.ripples_per_turn",
    )
    rated("[50, 0, 50, 80]").robot.require_known(SPACE.rates, "")


def geared(tmp_path, ripples_per_turn=None, **of_arm):
    """Prototype whose second arm has more values."""
    tree = PROTOTYPE.document.editable_tree()
    tree["geometry"]["arms"][1].update(of_arm)
    if ripples_per_turn:
        tree["ripples_per_turn"] = ripples_per_turn
    return read_robot(written(tmp_path, yaml_text(tree))).robot


def test_a_file_holds_transmission_where_it_is_not_0(tmp_path):
    errors = {"encoder_gain_ppm": -120.0, "ripple_cos_deg": 0.003, "backlash_deg": 0.01}
    robot = geared(tmp_path, ripples_per_turn=30.0, **errors)
    names = (*(f"arm1.{name}" for name in errors), "ripples_per_turn")
    assert robot.parameters.extended_by == names
    assert robot.digest() != PROTOTYPE.robot.digest()
    assert geared(tmp_path, backlash_deg=0.0).digest() == PROTOTYPE.robot.digest()
    # the mechanism computes with them: gain of the motion, ripple at its rate, half the backlash
    joints, side = np.full((1, 4), 0.3), np.array([[0.0, 1.0, 0.0, 0.0]])
    true = joints.copy()
    true[0, 1] += -120e-6 * 0.3 + np.radians(0.003) * np.cos(30.0 * 0.3) - np.radians(0.005)
    expected = PROTOTYPE.robot.kinematics.forward(true).values_or_raise()
    pose = robot.kinematics.forward(joints, approach=side).values_or_raise()
    assert pose == pytest.approx(expected, abs=1e-9)


def test_a_ripple_without_its_period_and_a_joint_that_turns_round_are_refused(tmp_path):
    with pytest.raises(ConfigInvalid, match=r"arm1\.ripple_sin_deg is 0\.01, but .* how often"):
        geared(tmp_path, ripple_sin_deg=0.01)
    with pytest.raises(ConfigInvalid, match=r"errors of a joint change by 0\.52 of its motion"):
        geared(tmp_path, ripple_sin_deg=1.0, ripples_per_turn=30.0)


lengths = st.floats(min_value=5.0, max_value=1e5)
places = st.floats(min_value=-1e5, max_value=1e5)
turns = st.floats(min_value=-360.0, max_value=360.0)
tilts = st.floats(min_value=-10.0, max_value=10.0).filter(bool)


def any_value_of(name):
    if name in AXIS_TILT_NAMES:
        return tilts
    if name.endswith("_deg"):
        return turns
    return places if name[-4:] in {"x_mm", "y_mm", "z_mm"} else lengths


@pytest.mark.slow
@given(
    geometry=st.fixed_dictionaries(
        {name: any_value_of(name) for name in SPACE.names},
        optional={name: any_value_of(name) for name in AXIS_TILT_NAMES},
    )
)
def test_any_parameters_come_back_from_the_file_bit_by_bit(geometry):
    robot = changed(geometry).robot
    assert robot.parameters == geometry


def test_the_half_that_carries_the_reflector_is_one_of_two():
    text = PROTOTYPE.document.text + "reflector_half: "
    told = parse_robot(f"{text}2", "robot.yaml")
    identified = compensated(told, "identified", told.robot.parameters).robot
    assert identified.mechanism == told.robot.mechanism != PROTOTYPE.robot.mechanism
    assert identified.digest() == PROTOTYPE.robot.digest()
    assert parse_robot(f"{text}1", "robot.yaml").robot.mechanism == PROTOTYPE.robot.mechanism
    of_delta = find_robot("delta").document.text
    for wrong, why in (
        (f"{text}3", "1 or 2"),
        (f"{of_delta}reflector_half: 1", "one part has no part 1"),
    ):
        with pytest.raises(ConfigInvalid, match=why):
            parse_robot(wrong, "robot.yaml")


def test_a_drives_period_is_in_the_file_and_stays_in_an_identified_set():
    shipped = find_robot("linear-delta")
    assert shipped.robot.mechanism.rate == 0.0
    geared = parse_robot(f"{shipped.document.text}drive_period_mm: 20.0\n", "robot.yaml")
    assert geared.robot.mechanism.rate == 20.0
    identified = compensated(geared, "identified", geared.robot.parameters)
    assert identified.robot.mechanism.rate == 20.0


def rated(text):
    """Return the prototype whose arms 0 and 2 ripple, with a line of rates."""
    tree = PROTOTYPE.document.editable_tree()
    for arm in (0, 2):
        tree["geometry"]["arms"][arm]["ripple_sin_deg"] = 0.01
    return parse_robot(f"{yaml_text(tree)}ripples_per_turn: {text}\n", "robot.yaml")


@pytest.mark.parametrize(
    ("text", "rates"),
    [
        ("50", (50.0, 50.0, 50.0, 50.0)),
        ("[50, 0, 50.0, null]", (50.0, 0.0, 50.0, 0.0)),
        ("[50, 0, 80, 60]", (50.0, 0.0, 80.0, 60.0)),
    ],
)
def test_each_joint_may_have_a_rate_of_its_own_that_stays_in_an_identified_set(text, rates):
    document = rated(text)
    assert document.robot.mechanism.rates == document.robot.parameters.rates == rates
    changed = document.robot.parameters | {"arm0.arm_mm": 351.0}
    for parameters in (changed, Parameters.of(SPACE, changed)):
        identified = compensated(document, "identified", parameters)
        assert f"ripples_per_turn: {text}\n" in identified.document.text
        assert identified.robot.mechanism.rates == rates


def test_rates_are_written_as_one_number_where_they_are_alike_and_else_as_a_list():
    own, alike = rated("[50, 0, 80, 0]"), rated("50")
    listed = compensated(alike, "listed", own.robot.parameters)
    assert "\nripples_per_turn: [50.0, 50.0, 80.0, 50.0]\n" in listed.document.text
    assert listed.robot.digest() == own.robot.digest() != alike.robot.digest()
    assert (
        "\nripples_per_turn: 50.0\n"
        in compensated(own, "one", dict(alike.robot.parameters)).document.text
    )


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("1", "ripples_per_turn is 1, must be a number from 2 to 10000"),
        ("0", "ripples_per_turn is 0, must be"),
        ("often", 'ripples_per_turn is "often", must be'),
        ("[50, 0, .nan, 50]", "ripples_per_turn holds NaN, must be"),
        ("true", "ripples_per_turn is true, must be"),
        ("[50, 50]", "robot.yaml:.*: ripples_per_turn holds 2 numbers, must hold 4 → give one"),
        ("[50, 0, 0, 0]", r"arm2\.ripple_sin_deg is 0\.01, but the file does not say how often"),
    ],
)
def test_wrong_rates_are_refused(text, why):
    with pytest.raises(ConfigInvalid, match=why):
        rated(text)


def toleranced(text):
    return parse_robot(f"{PROTOTYPE.document.text}tolerances: {{{text}}}\n", "robot.yaml").robot


def test_tolerances_are_those_of_the_table_unless_the_file_says_other():
    assert PROTOTYPE.robot.tolerances == {}
    table = ErrorModel(PROTOTYPE.robot.kinematics)
    own = toleranced("rods_deg: 0.05, lengths_mm: 0.3, ratio_ppm: 40.0").tolerances
    assert own == pytest.approx(
        {"rods_deg": np.radians(0.05), "lengths_mm": 0.3, "ratio_ppm": 4e-5}
    )
    stated = ErrorModel(PROTOTYPE.robot.kinematics, group_tolerances=own)
    for name, usual, now in zip(table.names, table.tolerance, stated.tolerance, strict=True):
        group = "" if name in TRACKER_SOURCES else SPACE[name].field.group
        unit = {"rods": "rods_deg", "lengths": "lengths_mm", "ratio": "ratio_ppm"}.get(group)
        assert now == (own[unit] if unit else usual), name


def test_stated_reflector_has_a_narrow_tolerance_or_its_own_one():
    def tolerances(lines):
        text = PROTOTYPE.document.text.replace("# reflector_mm: [x, y, z]", lines)
        return parse_robot(text, "stated.yaml").robot.tolerances

    place = "reflector_mm: [20.0, -30.0, -45.0]\n"
    assert tolerances(place) == {"reflector_mm": 3.0}
    assert tolerances(f"{place}reflector_std_mm: 0.5") == {"reflector_mm": 0.5}
    named = f"{place}tolerances: {{reflector_mm: 8.0, plate_joints_mm: 1.0}}"
    assert tolerances(named) == {"reflector_mm": 8.0, "plate_joints_mm": 1.0}
    assert tolerances("tolerances: {reflector_mm: 8.0}") == {"reflector_mm": 8.0}
    with pytest.raises(ConfigInvalid, match="reflector_mm, which is missing"):
        tolerances("reflector_std_mm: 0.5")


def test_fitted_places_on_the_plate_are_written_and_read_back(tmp_path):
    path, places = (
        tmp_path / "fitted.yaml",
        {"reflector_z_mm": -41.5, "arm2.plate_joint_x_mm": 3.25},
    )
    write_new_robot(path, changed(PROTOTYPE.robot.parameters | places, std={"reflector_z_mm": 2.0}))
    robot = read_robot(path).robot
    assert robot.parameters == PROTOTYPE.robot.parameters | places
    assert robot.parameters.std == {"reflector_z_mm": 2.0}
    limit = {name: robot.tolerance.of(SPACE[name]) for name in (*places, "arm0.x_mm")}
    assert limit == dict.fromkeys(places, 100.0) | {"arm0.x_mm": 10.0}


def test_robot_in_metres_is_refused_and_told_so(tmp_path):
    text = PROTOTYPE.document.text.replace("arm_mm: 350.0", "arm_mm: 0.35")
    text = text.replace("forearm_mm: 700.0", "forearm_mm: 0.7").replace(": 100.0", ": 0.1")
    said = refusal(ConfigInvalid, read_robot, written(tmp_path, text), begins=str(tmp_path))
    assert "arm0.forearm_mm is 0.7, and no length is above 5 mm: metres?" in said
    assert "such as 700" in said


def test_the_remark_on_a_set_names_only_what_its_mechanism_has():
    """`export --format plain` and pkmkins refuse a hexapod, so they are no advice for it."""
    par4, hexapod = (find_robot(name).robot for name in ("par4-prototype", "hexapod"))
    assert par4.remark == hexapod.remark == ""
    for robot, has_plain in ((par4, True), (hexapod, False)):
        name = next(word for word in robot.parameters.table.of_robot if "backlash" in word)
        values = Parameters.of(robot.parameters.table, robot.parameters | {name: 0.01})
        extended = RobotFile.of(robot.mechanism, values, name="found", limits=robot.limits)
        assert extended.is_extended
        assert ("--format plain" in extended.remark) == has_plain
        assert "pkmcal correct" in extended.remark
