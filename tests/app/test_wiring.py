"""Devices behind a campaign's addresses: which time each of them is judged by."""

from math import dist

import numpy as np
import pytest

from app.main import run_command
from app.wiring import connected_cell
from campaigns.campaign import open_campaign
from campaigns.journal.records import Event
from drivers.errors import NotAMeasurement
from drivers.values import Pose

NORMAL, FULL = 1, 2
"""Of SQLite's pragma: FULL waits until a commit is on the disk."""
CELL = """\
schema: pkmcal/cell/1
name: mine
speed_up: 4
robot: {nominal: par4-prototype}
tracker:
  station: {x_mm: 2000.0, y_mm: -1500.0, z_mm: -200.0}
  noise: {coordinate_mm: 0.01}
faults: [{at_result: 1, kind: early}]
"""


def test_simulated_tracker_of_a_campaign_is_judged_by_the_cells_time(tmp_path):
    folder = tmp_path / "cell"
    assert run_command(["new", str(folder)]) == 0
    (folder / "cell.yaml").write_text(CELL)
    with connected_cell(open_campaign(folder)) as cell:
        cell.tracker.prepare("CCR-1.5in", 0.5)
        with pytest.raises(NotAMeasurement, match="after its measurement was started"):
            cell.tracker.measure()
        assert cell.tracker.measure()


def test_noise_of_a_cell_whose_memory_was_deleted_follows_the_journal(tmp_path):
    folder = tmp_path / "cell"
    assert run_command(["new", str(folder)]) == 0
    campaign = open_campaign(folder)

    def point_of_a_new_cell():
        with connected_cell(campaign) as cell:
            cell.tracker.prepare("CCR-1.5in", 0.01)
            point_mm = cell.tracker.measure().point_in_tracker_mm
        (folder / "cell-memory.json").unlink()
        return point_mm

    first = point_of_a_new_cell()
    assert point_of_a_new_cell() == first
    with campaign.opened_journal() as journal:
        journal.append(Event("operator note", "measured"))
    later = point_of_a_new_cell()
    assert later != first
    assert later == pytest.approx(first, abs=0.2)
    assert point_of_a_new_cell() == later


@pytest.mark.parametrize(
    ("words", "synchronous"),
    [
        ((), NORMAL),
        (("--controller", "by-hand", "--tracker", "sim://paper-simulation"), FULL),
        (("--controller", "sim://paper-simulation", "--tracker", "by-hand"), FULL),
    ],
    ids=["two simulated devices", "a real robot", "a real tracker"],
)
def test_where_a_device_is_real_every_record_waits_for_the_disk(tmp_path, words, synchronous):
    assert run_command(["new", str(tmp_path / "new"), *words]) == 0
    with open_campaign(tmp_path / "new").opened_journal() as journal:
        for _ in range(2):
            found = journal._connection.execute("PRAGMA synchronous").fetchone()
            assert found == (synchronous,)
            journal.prove()  # which opens it anew


def test_simulated_tracker_sees_its_robot_where_a_real_controllers_joints_are(tmp_path):
    folder = tmp_path / "own"
    words = ("--controller", "by-hand", "--tracker", "sim://paper-simulation")
    assert run_command(["new", str(folder), *words]) == 0
    campaign = open_campaign(folder)
    kinematics, places = campaign.robot.kinematics, []
    with connected_cell(campaign, prompt=lambda _: "") as cell:
        cell.robot.prepare()
        cell.tracker.prepare("CCR-1.5in", 0.01)
        for pose in (Pose(0.0, 0.0, -575.0, 0.0), Pose(60.0, -40.0, -600.0, 0.1)):
            cell.robot.move_pose(pose, 0.5)
            joints = cell.robot.state().joints
            modelled = kinematics.forward(np.array([joints])).values[0, :3]
            assert modelled == pytest.approx([pose.x_mm, pose.y_mm, pose.z_mm], abs=0.01)
            places.append(cell.tracker.measure().point_in_tracker_mm)
    way = dist((0.0, 0.0, -575.0), (60.0, -40.0, -600.0))
    assert dist(*places) == pytest.approx(way, abs=3.0)  # the simulated robot has its own errors
    assert dist(*places) != pytest.approx(way, abs=1e-3)
    assert (folder / "cell.yaml").exists()
    assert not campaign.is_simulated


def test_simulated_controller_stands_beside_a_tracker_that_is_not_of_its_cell(tmp_path):
    folder = tmp_path / "own"
    words = ("--controller", "sim://realistic", "--tracker", "by-hand")
    assert run_command(["new", str(folder), *words]) == 0
    with connected_cell(open_campaign(folder), prompt=lambda _: "2500,5 0,25 -75,125") as cell:
        assert cell.robot.identity().protocol == "robotline 1"
        assert cell.tracker.identity().protocol == "by hand"
        assert cell.tracker.measure().point_in_tracker_mm == (2500.5, 0.25, -75.125)
