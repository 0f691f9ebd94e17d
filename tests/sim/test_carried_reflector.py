"""The one reflector of a cell, carried to the other half of the plate and back."""

import json

import numpy as np
import pytest

from sim.cell import Cell
from sim.errors import SimError
from sim.robot.section import RobotSection
from sim.scenarios.scenario import load_scenario

OWN_MM = (20.0, -30.0, -45.0)
"""Place of the reflector on half 1, as cell files have it that do not say otherwise."""
HALF_2 = ("half 2", 2, OWN_MM, 1.0)
APART_MM = 103.0
"""Distance of the halves of the paper's prototype, about."""


def stopped_at(cell, theta_rad):
    """Stand at the middle with this turn; return the time of the arrival."""
    return cell.controller.move_pose(0.0, 0.0, -575.0, theta_rad, 1.0, 0.0)


def test_it_is_on_the_other_half_and_back_where_it_was():
    cell = Cell(load_scenario("realistic"), seed=3)
    now_s = stopped_at(cell, 0.0)
    before = cell.true_reflector_mm(now_s)
    cell.carry_reflector(*HALF_2)
    away = cell.true_reflector_mm(now_s) - before
    assert np.linalg.norm(away) == pytest.approx(APART_MM, abs=5.0)
    cell.carry_reflector("", None, (0.0, 0.0, 0.0), 0.0)
    assert cell.true_reflector_mm(now_s) == pytest.approx(before, abs=1e-12)


def test_the_beam_goes_with_it():
    cell = Cell(load_scenario("realistic"), seed=3)
    cell.tracker.beam.release()
    cell.carry_reflector(*HALF_2)
    seen_mm = cell.station.to_tracker_mm(cell.true_reflector_mm(0.0))
    assert cell.tracker.beam.point_in_tracker_mm(0.0) == pytest.approx(seen_mm, abs=1e-9)


def test_the_other_half_moves_round_the_first_when_the_plate_turns():
    at = []
    for theta_rad in (-0.5, 0.5):
        cell = Cell(load_scenario("realistic"), seed=3)
        cell.carry_reflector(*HALF_2)
        at.append(cell.true_reflector_mm(stopped_at(cell, theta_rad)))
    moved = np.subtract(*at)
    assert np.linalg.norm(moved) == pytest.approx(2.0 * np.sin(0.5) * APART_MM, abs=5.0)


def test_a_holder_is_off_its_place_by_the_same_draw_each_time():
    offsets = []
    for std_mm in (0.0, 1.0, 1.0):
        cell = Cell(load_scenario("realistic"), seed=3)
        cell.carry_reflector("half 2", 2, OWN_MM, std_mm)
        offsets.append(cell.true_reflector_mm(0.0))
    assert 0.1 < np.linalg.norm(offsets[1] - offsets[0]) < 5.0
    assert offsets[2] == pytest.approx(offsets[1], abs=1e-12)


def test_a_cell_that_goes_on_has_it_where_it_was_carried():
    scenario = load_scenario("realistic")
    cell = Cell(scenario, seed=3)
    cell.carry_reflector(*HALF_2)
    memory = json.loads(json.dumps(cell.memory()))
    again = Cell(scenario, memory=memory)
    assert again.true_reflector_mm(0.0) == pytest.approx(cell.true_reflector_mm(0.0), abs=1e-12)
    del memory["carried"]  # as an older version wrote it
    own_mm = Cell(scenario, seed=3).true_reflector_mm(0.0)
    assert Cell(scenario, memory=memory).true_reflector_mm(0.0) == pytest.approx(own_mm, abs=1e-9)


def test_a_platform_of_one_part_has_no_half_to_carry_it_to():
    scenario = load_scenario("realistic")
    robot = RobotSection(mechanism="delta", nominal="delta")
    cell = Cell(scenario.model_copy(update={"robot": robot}))
    with pytest.raises(SimError, match="no halves"):
        cell.carry_reflector(*HALF_2)
