"""Every scenario, made a cell of every robot of the family."""

from types import SimpleNamespace

import numpy as np
import pytest
from family_cases import MEMBERS

from app.cli.devices import facts_of_controller
from app.new_campaign import cell_text, create_simulated
from campaigns.campaign import open_campaign
from campaigns.robots.program import Program, trust
from campaigns.robots.robot import find_robot
from drivers.values import Identity, RobotState
from sim.cell import Cell
from sim.scenarios.scenario import load_scenario, parse_scenario, scenario_text, shipped_scenarios

all_members = pytest.mark.parametrize("member", MEMBERS, ids=lambda each: each.name)
all_scenarios = pytest.mark.parametrize("name", shipped_scenarios())


def cell_of(member, name):
    return Cell(parse_scenario(cell_text(member.shipped, name), name))


@pytest.mark.parametrize(
    ("member", "name"),
    [
        *((member, "realistic") for member in MEMBERS),
        *((MEMBERS[-1], name) for name in shipped_scenarios() if name != "realistic"),
    ],
    ids=lambda each: getattr(each, "name", each),
)
def test_stands_in_the_middle_of_its_workspace_with_limits_that_it_can_meet(member, name):
    cell = cell_of(member, name)
    assert cell.kind.name == member.name
    assert cell.controller.geometry() == pytest.approx(dict(member.shipped.parameters), abs=1e-9)
    plate = cell.robot.standing.assembly.plate
    assert np.abs(plate.position_mm - member.shipped.workspace_centre[:3]).max() < 60.0
    assert cell.memory()["mechanism"] == member.name
    rotation_mm = cell.scenario.acceptance.rotation_mm
    assert name != "realistic" or (rotation_mm is not None) == (len(member.mechanism.task) > 3)


def test_gears_of_cranks_become_drives_by_the_way_of_a_crank_of_300_mm():
    text = cell_text(find_robot("linear-delta").robot, "gears").replace(
        "ripple_mm", "ratio_ppm: 50.0\n    ripple_mm"
    )
    told = parse_scenario(text, "cell").robot.transmission
    assert told.ripple_mm == pytest.approx(300.0 * np.radians(10.0 / 3600.0), abs=1e-5)
    assert told.pitch_mm == pytest.approx(2.0 * np.pi * 300.0 / 30.0, abs=1e-5)
    assert (told.eccentricity_um, told.ratio_ppm) == (0.0, 50.0)


def test_motors_of_unlike_rates_have_their_mean_at_other_arms(tmp_path):
    cell, turns = tmp_path / "cell.yaml", "ripples_per_turn: [30.0, 30.0, 50.0, 50.0]"
    gears = scenario_text("gears").replace("ripples_per_turn: 30.0", turns)
    cell.write_text(gears, encoding="utf-8")
    text = cell_text(find_robot("delta").robot, str(cell))
    assert parse_scenario(text, "cell").robot.transmission.ripples_per_turn == 40.0


@all_members
def test_its_errors_are_as_large_as_the_scenario_s(member):
    """Of the robot's own parameters, drawn by the seed; the frame's are nominal."""
    nominal = dict(member.shipped.parameters)
    text = cell_text(member.shipped, "paper-simulation")
    scenario = parse_scenario(text, "cell")
    errors = []
    for seed in range(20):
        true = Cell(scenario, seed=seed).true_geometry
        errors += [true[name] - nominal[name] for name in nominal if name.endswith("forearm_mm")]
        assert true["arm0.x_mm"] == nominal["arm0.x_mm"]
    told = load_scenario("paper-simulation").robot.errors.items()
    sizes = [error for name, error in told if name.endswith(("arm_mm", "plate_mm"))]
    assert np.std(errors) == pytest.approx(np.sqrt(np.mean(np.square(sizes))), rel=0.3)


@all_scenarios
def test_of_the_same_robot_is_the_scenario_as_it_was_written(name):
    assert cell_text(find_robot("par4-prototype").robot, name) == scenario_text(name)


REACHING_ARM = """
import numpy as np
from pkmcal import PLANE, ImplicitMechanism, ParameterField, transmission_fields


class ReachingArm(ImplicitMechanism):
    joint_kinds = ("prismatic", "revolute")
    task_axes = PLANE
    arm_fields = (
        ParameterField("joint_offset_mm", "offset, mm", "length", "offsets"),
        ParameterField("joint_offset_deg", "offset, deg", "angle", "offsets"),
        *transmission_fields("deg", "gear"),
    )

    def misfit(self, fields, joints, pose):
        return pose - self.first_pose(fields, joints)

    def first_joints(self, fields, poses):
        x, y = poses.T
        return np.stack([np.hypot(x, y), np.arctan2(y, x)], axis=1)

    def first_pose(self, fields, joints):
        reach, angle = joints[..., 0], joints[..., 1]
        return np.stack([reach * np.cos(angle), reach * np.sin(angle)], axis=-1)


ARM = ReachingArm("arm.py:ARM")
"""
REACHING_ROBOT = """schema: pkmcal/robot/1
mechanism: arm.py:ARM
name: reaching
geometry:
  arms:
    - {joint_offset_mm: 300.0}
    - {joint_offset_deg: 10.0}
limits:
  joint_mm: [0.0, 400.0]
  joint_deg: [-120.0, 120.0]
  x_mm: [350.0, 550.0]
  y_mm: [-150.0, 150.0]
"""


def test_gears_behind_a_drive_have_their_rate_from_the_data_sheet(tmp_path):
    (tmp_path / "arm.py").write_text(REACHING_ARM, encoding="utf-8")
    trust(Program.read(tmp_path / "arm.py"))
    file = tmp_path / "reaching.yaml"
    file.write_text(REACHING_ROBOT, encoding="utf-8")
    create_simulated(tmp_path / "cell", str(file), "gears")
    gears = load_scenario(str(tmp_path / "cell" / "cell.yaml")).robot.transmission
    campaign = open_campaign(tmp_path / "cell")
    assert set(campaign.robot.mechanism.rates) == {gears.ripples_per_turn}


def test_joints_of_both_kinds_are_listed_each_with_its_unit(tmp_path):
    (tmp_path / "arm.py").write_text(REACHING_ARM, encoding="utf-8")
    trust(Program.read(tmp_path / "arm.py"))
    (tmp_path / "reaching.yaml").write_text(REACHING_ROBOT, encoding="utf-8")
    robot = find_robot(str(tmp_path / "reaching.yaml")).robot
    state = RobotState((120.0, 0.5), moving=False, fault="", emergency_stop=False)
    identity = Identity("maker", "model", "7", "1", "robotline 1")
    controller = SimpleNamespace(identity=lambda: identity, state=lambda: state)
    facts = facts_of_controller(SimpleNamespace(robot=robot), controller)
    assert (facts["q0_mm"], facts["q1_deg"]) == (120.0, pytest.approx(28.647890))
    assert "joints_mm" not in facts


@pytest.mark.parametrize("name", ["delta", "h4", "i4r", "five-bar", "par4-table1"])
def test_only_a_par4_gets_the_papers_errors_without_being_asked(name, tmp_path):
    """With them a Delta's and an I4's dry run was refused by `load`, and an H4 got stuck."""
    create_simulated(tmp_path / "c", name)
    wanted = "paper-prototype" if name.startswith("par4") else "realistic"
    assert f"name: {wanted}\n" in (tmp_path / "c" / "cell.yaml").read_text(encoding="utf-8")
