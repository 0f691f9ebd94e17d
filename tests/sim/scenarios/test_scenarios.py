"""Scenario files: the shipped ones are what they say, and a wrong one is explained."""

import math

import pytest
from refusals import refusal

from campaigns.robots.robot import find_robot
from sim.cell import Cell
from sim.errors import ScenarioInvalid
from sim.robot.section import nominal_robot
from sim.scenarios.scenario import load_scenario, parse_scenario, shipped_scenarios

MINIMAL = """\
schema: pkmcal/cell/1
name: mine
robot: {nominal: par4-prototype}
tracker:
  station: {x_mm: 2000.0, y_mm: -1500, z_mm: -200.0}
  noise: {coordinate_mm: 0.01}
"""


def explained(text):
    return refusal(ScenarioInvalid, parse_scenario, text, "cell.yaml", begins="cell.yaml:")


def test_six_scenarios_are_shipped_and_each_makes_a_cell_with_limits():
    names = "drawn-robots gears hostile paper-prototype paper-simulation realistic"
    assert " ".join(shipped_scenarios()) == names
    for name in shipped_scenarios():
        scenario = load_scenario(name)
        assert scenario.name == name
        limits = scenario.acceptance
        assert 0.0 < limits.distance_mean_mm < limits.distance_max_mm
        assert limits.repeatability_mm is None, "calibration does not change it"
        assert Cell(scenario).tracker.live_point(0.0) is not None


def test_gears_of_carriages_and_of_cranks_are_not_mistaken_for_each_other():
    robot = "robot: {nominal: par4-prototype"
    for key in ("transmission: {ripple_mm: 0.01}", "weight: {drive_n_per_um: 5.0}"):
        line = explained(MINIMAL.replace(robot, f"{robot}, {key}"))
        assert "of other arms than a par4 has" in line
    heavy = parse_scenario(
        MINIMAL.replace(robot, f"{robot}, weight: {{gear_nm_per_arcmin: 10.0}}"), "cell.yaml"
    )
    sunk = Cell(heavy).robot._behaviour.load
    assert sunk.stiffness == pytest.approx(10.0 * 1e3 * 60.0 * 180.0 / math.pi)
    assert sunk.at_elbow_n == pytest.approx(9.81 * 0.65)
    assert sunk.at_plate_n == pytest.approx(9.81 * 1.6)


def test_each_motor_may_have_a_rate_of_its_own():
    robot = "robot: {nominal: par4-prototype"
    gears = ", transmission: {{ripple_arcsec: 10.0, ripples_per_turn: {}}}"
    one, each, few = (
        MINIMAL.replace(robot, robot + gears.format(rates))
        for rates in ("30", "[30, 30.0, 50, 100]", "[30, 50]")
    )
    motors = [
        Cell(parse_scenario(text, "cell.yaml")).robot._behaviour.transmission.motor_rad.tolist()
        for text in (one, each)
    ]
    assert motors == [[30.0] * 4, [30.0, 30.0, 50.0, 100.0]]
    assert "transmission.ripples_per_turn has 2 entries, a par4 has 4" in explained(few)
    line = explained(each.replace("50,", "-50,"))
    assert "transmission.ripples_per_turn is inconsistent: give a number above 0" in line


def test_realistic_robots_differ_by_seed_as_their_tolerances_say():
    scenario = load_scenario("realistic")
    nominal = nominal_robot("par4-prototype")[1]
    made = [Cell(scenario, seed=seed).true_geometry for seed in range(30)]
    lengths = [flat[f"arm{arm}.arm_mm"] - 350.0 for flat in made for arm in range(4)]
    assert math.sqrt(sum(d * d for d in lengths) / len(lengths)) == pytest.approx(0.3, rel=0.25)
    turns = [flat["arm2.azimuth_deg"] - nominal["arm2.azimuth_deg"] for flat in made]
    assert 0.015 < max(map(abs, turns)) < 0.12
    assert all(flat["arm0.x_mm"] == nominal["arm0.x_mm"] for flat in made)
    assert Cell(scenario, seed=3).true_geometry == made[3]


def test_a_minimal_scenario_is_an_ideal_robot_and_is_read_from_a_file(tmp_path):
    (tmp_path / "mine.yaml").write_text(MINIMAL)
    scenario = load_scenario(str(tmp_path / "mine.yaml"))
    assert scenario.name == "mine"
    cell = Cell(scenario)
    assert cell.true_geometry == dict(nominal_robot("par4-prototype")[1])
    assert cell.controller.geometry() == cell.true_geometry
    assert cell.tracker.serial == "390001"


@pytest.mark.parametrize("name", ["delta", "linear-delta", "h4", "i4r", "i4l", "par4-table1"])
def test_any_shipped_robot_is_a_nominal_one(name):
    robot = find_robot(name).robot
    section = f"mechanism: {robot.mechanism.name}, nominal: {name}"
    text = MINIMAL.replace("nominal: par4-prototype", section)
    flat = parse_scenario(text, "mine").robot.nominal_flat()
    assert flat == {each: robot.parameters[each] for each in flat}


def test_a_robot_can_be_written_out_in_full():
    arms = "".join(
        f"      - {{x_mm: {x}, y_mm: {y}, z_mm: 0, azimuth_deg: {a}, joint_offset_deg: 0,"
        " arm_mm: 350, forearm_mm: 700}\n"
        for x, y, a in ((-170, -220, 225), (170, -220, 315), (170, 220, 45), (-170, 220, 135))
    )
    geometry = f"robot:\n  geometry:\n    arms:\n{arms}    plate_mm: 99\n"
    text = MINIMAL.replace("robot: {nominal: par4-prototype}\n", geometry)
    assert Cell(parse_scenario(text, "cell.yaml")).true_geometry["arm2.x_mm"] == 170.0


def test_an_unknown_scenario_names_the_nearest():
    with pytest.raises(ScenarioInvalid, match=r"did you mean realistic\?"):
        load_scenario("realistik")


@pytest.mark.parametrize(
    ("wrong", "instead", "words"),
    [
        ("coordinate_mm", "coordinat_mm", ("tracker.noise.coordinat_mm", "mean coordinate_mm?")),
        ("name: mine", "name: mine\nsed: 3", ("sed is not a known key", "did you mean seed?")),
        ("z_mm: -200.0", "z_mm: text", ("tracker.station.z_mm", "valid number")),
        ("z_mm: -200.0", "z_mm: .nan", ("tracker.station.z_mm",)),
        ("name: mine", "name: mine\nacceptance: {rotation_mm: -1.0}", ("rotation_mm",)),
        (", z_mm: -200.0", "", ("tracker.station.z_mm is missing",)),
        ("par4-prototype", "par4-prototipe", ("did you mean par4-prototype?",)),
        ("par4-prototype", "delta", ("nominal 'delta' is no par4; give mechanism: delta",)),
        ("coordinate_mm: 0.01", "coordinate_mm: -1", ("noise.coordinate_mm", "greater than 0")),
        ("coordinate_mm: 0.01", "along: {constant_um: 1, per_metre_um: 1}", ("either",)),
        ("par4-prototype", "par4-prototype, errors: {arm1.arm: 1}", ("mean arm1.arm_mm?",)),
        ("par4-prototype", "par4-prototype, errors: {plate_mm: -100}", ("a length is above 0",)),
        ("name: mine", "name: mine\nfaults: [{at_move: 1, kind: late}]", ("faults.0", "stall")),
        ("name: mine", "name: mine\nfaults: [{kind: late}]", ("exactly one of",)),
        ("name: mine", "name: mine\nfaults: [{at_answer: 1, kind: late}]", ("device",)),
        ("sch", "faults: [{at_measurement: 1, kind: wrong_target}]\nsch", ("other_reflector",)),
        ("sch", f"faults: [{', '.join(['{at_move: 1, kind: stall}'] * 2)}]\nsch", ("same place",)),
        ("name: mine", "name: mine\nname: yours", ("cell.yaml:3", "duplicate key")),
        ("cell/1", "cell/2", ("begin with 'schema: pkmcal/cell/1'",)),
        ("name: mine", "name: mine\nspeed_up: 0", ("speed_up",)),
    ],
)
def test_a_wrong_entry_is_named_with_its_place(wrong, instead, words):
    line = explained(MINIMAL.replace(wrong, instead))
    for word in words:
        assert word in line


@pytest.mark.parametrize("text", ["", "[", "- 1", "hello", "a: *b", "\x00", "{[1]: 2}", "!!x 3"])
def test_what_is_no_scenario_at_all_is_refused(text):
    explained(text)


def test_a_robot_that_cannot_stand_at_its_start_is_refused():
    far = MINIMAL + "controller: {start: {z_mm: -1500.0}}\n"
    with pytest.raises(ScenarioInvalid, match=r"controller\.start"):
        Cell(parse_scenario(far, "cell.yaml"))
