"""Instruments of the simulated cell: their truth by the tool's, and noise of the stated σ."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from sim.cell import Cell
from sim.errors import SimError
from sim.instruments import ReadObject, rotation_vector_rad
from sim.scenarios.scenario import load_scenario

BED = ReadObject("bed")
STD_MM = 0.02


@pytest.fixture
def cell():
    return Cell(load_scenario("realistic"), seed=5)


def go(cell, x_mm, y_mm, z_mm, theta_rad=0.0, now_s=0.0):
    """Move there; return the time of the arrival and the true place of the tool."""
    now_s += cell.controller.move_pose(x_mm, y_mm, z_mm, theta_rad, 1.0, now_s)
    return now_s, *cell.robot.tool(cell.controller.encoders(now_s))


def test_heights_are_those_above_one_plane(cell):
    now_s, points, heights = 0.0, [], []
    for x_mm, y_mm in [(-100, -100), (-100, 100), (100, -100), (100, 100), (0, 0), (50, 120)]:
        now_s, point, _ = go(cell, x_mm, y_mm, -600.0 + 0.003 * x_mm * y_mm, now_s=now_s)
        points.append(point)
        heights.append(cell.read_instrument("height", BED, 1e-6, now_s)[0])
    columns = np.column_stack([np.array(points), np.ones(len(points))])
    plane, *_ = np.linalg.lstsq(columns, heights, rcond=None)
    assert np.linalg.norm(columns @ plane - heights) < 1e-4
    assert np.linalg.norm(plane[:3]) == pytest.approx(1.0, abs=1e-6)  # along its normal
    assert 1e-5 < np.linalg.norm(plane[:2]) < 0.01  # a bed is never level


def test_readings_scatter_by_the_stated_sigma_and_the_truth_is_kept(cell):
    now_s, *_ = go(cell, 30.0, 40.0, -600.0)
    read = [cell.read_instrument("height", BED, STD_MM, now_s)[0] for _ in range(60)]
    assert np.std(read) == pytest.approx(STD_MM, rel=0.3)
    kept = cell.memory()["readings"]
    assert [entry["values"] for entry in kept] == [[value] for value in read]
    assert {tuple(entry["true"]) for entry in kept} == {(kept[0]["true"][0],)}
    assert abs(np.mean(read) - kept[0]["true"][0]) < STD_MM


def test_a_cell_that_goes_on_draws_no_noise_again(cell):
    now_s, *_ = go(cell, 30.0, 40.0, -600.0)
    first = cell.read_instrument("height", BED, STD_MM, now_s)
    again = Cell(load_scenario("realistic"), memory=json.loads(json.dumps(cell.memory())))
    assert again.read_instrument("height", BED, STD_MM, 0.0) != first
    assert len(again.memory()["readings"]) == 2


def test_a_drawn_part_has_shrunk(cell):
    part = ReadObject("part", shrinkage=0.004, std=0.0)
    now_s, first, _ = go(cell, -80.0, 0.0, -600.0)
    cell.mark(now_s)
    now_s, second, _ = go(cell, 80.0, 30.0, -600.0, now_s=now_s)
    (length_mm,) = cell.read_instrument("distance", part, 1e-6, now_s)
    assert length_mm == pytest.approx(0.996 * np.linalg.norm(second - first), abs=1e-4)


def test_a_block_stands_on_its_bed(cell):
    now_s, *_ = go(cell, 10.0, -20.0, -600.0)
    (height_mm,) = cell.read_instrument("height", BED, 1e-6, now_s)
    block = ReadObject("block", on="bed", height_mm=30.0)
    (above_mm,) = cell.read_instrument("block", block, 1e-6, now_s)
    assert above_mm == pytest.approx(height_mm - 30.0, abs=1e-4)


def test_a_probe_turns_with_the_tool(cell):
    probe, station = ReadObject("probe", place_mm=(40.0, 0.0, -60.0)), cell.station
    poses = []
    for theta_rad in (-0.4, 0.4):
        now_s, point, axes = go(cell, 20.0, 10.0, -600.0, theta_rad)
        seen = np.array(cell.read_instrument("probe", probe, 1e-9, now_s))
        at_mm = station.to_tracker_mm(point + axes @ np.array(probe.place_mm))
        assert seen[:3] == pytest.approx(at_mm, abs=1e-6)
        poses.append(
            Rotation.from_matrix(station.base_from_tracker) * Rotation.from_rotvec(seen[3:])
        )
    turn = (poses[1] * poses[0].inv()).as_rotvec()
    assert turn[2] == pytest.approx(0.8, abs=0.02)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 0.7, 3.1, np.pi])
def test_rotation_vectors_give_their_rotations_back(angle):
    turn = Rotation.from_rotvec(angle * np.array([0.6, -0.48, 0.64]))
    vector = rotation_vector_rad(turn.as_matrix())
    assert np.linalg.norm(vector) == pytest.approx(angle, abs=1e-7)
    assert Rotation.from_rotvec(vector).as_matrix() == pytest.approx(turn.as_matrix(), abs=1e-7)


def test_what_it_has_no_instrument_for_is_named(cell):
    with pytest.raises(SimError, match="no instrument for the kind 'edge'"):
        cell.read_instrument("edge", BED, 0.1, 0.0)
