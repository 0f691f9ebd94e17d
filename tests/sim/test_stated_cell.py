"""A cell of a mechanism that has no parts here, moved by equations from outside."""

import json
from dataclasses import dataclass

import numpy as np
import pytest

from sim.cell import Cell
from sim.errors import ScenarioInvalid, SimError
from sim.robot.controller import Refusal
from sim.scenarios.adaptation import WantedRobot, adapted, computing_all
from sim.scenarios.scenario import parse_scenario, scenario_text

FLAT = {
    "arm0.joint_offset_deg": 10.0,
    "arm1.joint_offset_mm": 300.0,
    "arm2.joint_offset_mm": -500.0,
    "column_tilt_deg": 0.0,
}
"""A column that turns and lifts an arm, which reaches out."""
ROBOT = WantedRobot(
    mechanism="column",
    geometry=FLAT,
    units=("deg", "mm", "mm"),
    joint_limits=((-90.0, 90.0), (0.0, 200.0), (-100.0, 100.0)),
    centre_mm=(350.0, 100.0, -500.0),
    turns_deg={},
    zeros=("arm2.lean_deg",),
    reflector_mm=(0.0, 0.0, 0.0),
)


@dataclass(frozen=True)
class Column:
    flat: dict

    def __post_init__(self):
        assert self.flat.keys() - {"arm2.lean_deg"} == FLAT.keys()

    @property
    def offsets(self):
        turn, out, lift = list(self.flat.values())[:3]
        return np.array([np.radians(turn), out, lift])

    def pose(self, joints, near):
        turn, out, lift = joints + self.offsets
        return np.array([out * np.cos(turn), out * np.sin(turn), lift, 0.0, 0.0, 0.0])

    def joints(self, pose):
        out = np.hypot(pose[0], pose[1])
        turn = np.arctan2(pose[1], pose[0]) if out < 1000.0 else np.nan
        return np.array([turn, out, pose[2]]) - self.offsets


def scenario_for(robot=ROBOT, name="realistic"):
    return parse_scenario(adapted(scenario_text(name), robot), name)


def made(**options):
    return Cell(scenario_for(), equations=Column, **options)


def moved(cell, joints, now_s):
    now_s += cell.controller.move_joints(joints, 1.0, now_s)
    return cell.true_reflector_mm(now_s), now_s


TARGET = (np.radians(5.0), 30.0, -20.0)


def test_it_moves_by_its_own_equations_with_gears_play_and_noise():
    cell = made()
    there, _ = moved(cell, TARGET, 0.0)
    ideal = Column(cell.true_geometry).pose(np.array(TARGET), None)[:3]
    assert 1e-4 < np.abs(there - ideal).max() < 0.2
    by_drawing = Column(FLAT).pose(np.array(TARGET), None)[:3]
    assert np.abs(by_drawing - ideal).max() > 0.05


def test_a_restart_goes_on_where_it_stood():
    cell = made()
    there, _ = moved(cell, TARGET, 0.0)
    after = made(memory=json.loads(json.dumps(cell.memory())))
    assert np.array_equal(after.true_reflector_mm(0.0), there)
    assert after.memory() == cell.memory()


def test_each_joint_keeps_its_own_limits():
    with pytest.raises(Refusal, match=r"joint 1 to 210\.0000 mm, limits 0 mm to 200 mm"):
        made().controller.move_joints([0.0, 210.0, 0.0], 1.0, 0.0)
    with pytest.raises(Refusal, match=r"joint 0 to 95\.0000°, limits -90° to 90°"):
        made().controller.move_joints([np.radians(95.0), 10.0, 0.0], 1.0, 0.0)


def test_its_controller_moves_to_a_pose_by_the_same_equations():
    cell = made()
    now_s = cell.controller.move_pose(330.0, 90.0, -520.0, 0.0, 1.0, 0.0)
    joints = Column(FLAT).joints(np.array([330.0, 90.0, -520.0]))
    assert cell.controller.state(now_s).joints == pytest.approx(joints, abs=1e-5)
    with pytest.raises(Refusal, match="cannot reach"):
        cell.controller.move_pose(2000.0, 0.0, -520.0, 0.0, 1.0, now_s)


def test_gears_that_the_controller_knows_count_once():
    text = computing_all(adapted(scenario_text("realistic"), ROBOT))
    cell = Cell(parse_scenario(text, "column"), equations=Column)
    cell.controller.replace_geometry(FLAT | {"arm1.encoder_gain_ppm": 1e4}, 0.0)
    now_s = cell.controller.move_pose(330.0, 90.0, -520.0, 0.0, 1.0, 0.0)
    joints = Column(FLAT).joints(np.array([330.0, 90.0, -520.0])) / [1.0, 1.01, 1.0]
    assert cell.controller.state(now_s).joints == pytest.approx(joints, abs=1e-5)


def test_without_its_equations_it_is_refused_with_the_way_out():
    with pytest.raises(SimError, match="nothing here simulates a column") as error:
        Cell(scenario_for())
    assert "pkmcal new" in error.value.remedy


def test_a_robot_of_equal_errors_has_sizes_for_both_kinds_of_joints():
    robot = scenario_for(name="gears").robot
    assert robot.backlash_arcmin == (0.3, 0.0, 0.0)
    assert robot.backlash_mm == pytest.approx((0.0, 0.02618, 0.02618), abs=1e-5)
    assert robot.transmission.ripple_arcsec == 10.0
    assert robot.transmission.ripple_mm == pytest.approx(0.014544, abs=1e-6)
    kind = scenario_for(name="gears").robot.kind
    assert kind.names == tuple(FLAT)
    assert kind.extensions == ("arm2.lean_deg",)


def test_parameters_that_are_0_by_the_drawing_are_drawn_and_can_be_loaded():
    cell = made()
    assert 0.0 < abs(cell.true_geometry["arm2.lean_deg"]) < 0.2
    assert "arm2.lean_deg" not in cell.controller.geometry()
    cell.controller.replace_geometry(FLAT | {"arm2.lean_deg": 0.1}, 0.0)
    assert cell.controller.geometry()["arm2.lean_deg"] == 0.1


def test_a_kind_with_another_number_of_arms_is_refused():
    text = adapted(scenario_text("realistic"), ROBOT).replace("[deg, mm, mm]", "[deg, mm]")
    with pytest.raises(ScenarioInvalid, match="geometry has 3 arms, a column has 2"):
        parse_scenario(text, "column.yaml")
