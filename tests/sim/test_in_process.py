"""A cell in this process: the real drivers over pipes of memory, and time that nobody waits for."""

import shutil
import threading
import time

import pytest
from command_line import change
from robotline_layouts import PAR4_LAYOUT

from app.main import run_command
from campaigns.journal.journal import read_journal
from drivers.declaration import RobotSurroundings, Surroundings
from drivers.emscon.tracker import EmsconTracker
from drivers.errors import DriverError, LinkDown
from drivers.robotline import LineRobot, RobotlineDeadlines
from drivers.values import Pose
from sim.cell import Cell
from sim.clock import EventClock
from sim.in_process import InProcessCell
from sim.scenarios.scenario import load_scenario
from sim.scenarios.schema import FaultSection

FEW_SHOTS = {"plan.shots": 8, "plan.validation_pairs": 1, "plan.drift_shots": 2, "run.retry": 3}
TROUBLES = [
    {"at_measurement": 3, "kind": "beam_break", "seconds": 4},
    {"at_move": 5, "kind": "drive_fault", "seconds": 5},
    {"device": "controller", "at_answer": 300, "kind": "late", "seconds": 40},
    {"device": "tracker", "at_answer": 60, "kind": "garbage"},
]


def opener_of(cell, device):
    return lambda **_: cell.connect(device, f"sim://cell/{device}")


class Bench:
    """The controller's driver at a cell whose controller's answers have one fault."""

    def __init__(self, kind=None, seconds=None):
        scenario = load_scenario("paper-simulation")
        if kind is not None:
            fault = FaultSection(device="controller", at_answer=2, kind=kind, seconds=seconds)
            scenario = scenario.model_copy(update={"faults": (fault,)})
        self.cell = InProcessCell(Cell(scenario), EventClock())
        opener = opener_of(self.cell, "controller")
        self.robot = LineRobot(
            RobotSurroundings(open_transport=opener, layout=PAR4_LAYOUT, clock=self.cell)
        )
        self.robot.connect()


@pytest.mark.parametrize("kind", ["silent", "late", "torn"])
def test_silent_device_is_given_up_at_the_deadline_in_the_cells_time_and_no_real_time(kind):
    bench, began_s = Bench(kind, 3600.0), time.monotonic()
    with pytest.raises(LinkDown, match="no answer to STATE within 2 s"):
        bench.robot.state()
    assert bench.cell.now_s() == pytest.approx(RobotlineDeadlines().answer_s)
    assert time.monotonic() - began_s < 1.0


def test_answer_that_comes_within_the_deadline_is_waited_for():
    bench = Bench("late", 1.5)
    bench.robot.state()
    assert bench.cell.now_s() == pytest.approx(1.5)


def test_device_that_closes_the_connection_is_named_and_takes_the_next_one():
    bench = Bench("close")
    with pytest.raises(LinkDown, match="sim://cell/controller: the device closed the connection"):
        bench.robot.state()
    bench.robot.reconnect()
    assert bench.robot.state().joints


def test_clock_without_a_pace_waits_for_nobody_and_one_with_a_pace_keeps_it():
    hurried, paced, began_s = EventClock(), EventClock(speed_up=100.0), time.monotonic()
    hurried.sleep_s(1e6)
    assert time.monotonic() - began_s < 1.0
    for _ in range(100):
        paced.sleep_s(0.1)
    assert time.monotonic() - began_s > 0.095
    assert (hurried.now_s(), paced.now_s()) == (1e6, pytest.approx(10.0))


def visits(fault):
    """Move to six poses and measure each through the drivers, over a broken line; all figures."""
    scenario = load_scenario("realistic").model_copy(update={"faults": (fault,)})
    cell = InProcessCell(Cell(scenario), EventClock())
    robot = LineRobot(
        RobotSurroundings(
            open_transport=opener_of(cell, "controller"), layout=PAR4_LAYOUT, clock=cell
        )
    )
    given = Surroundings(open_transport=opener_of(cell, "tracker"), clock=cell, in_process=True)
    tracker, figures = EmsconTracker(given), []
    robot.connect()
    tracker.connect()
    tracker.prepare("CCR-1.5in", 0.5)
    for x_mm in range(6):
        robot.move_pose(Pose(10.0 * x_mm, 0.0, -575.0, 0.0), 1.0)
        while robot.state().moving:
            cell.sleep_s(0.01)
        try:
            measured = tracker.measure().point_in_tracker_mm
        except DriverError as error:
            measured = str(error)
            tracker.reconnect()
        figures.append((cell.now_s(), robot.state().joints, measured))
    return figures


def test_two_cells_of_one_seed_give_the_same_figures_at_the_same_times():
    fault = FaultSection(device="tracker", at_answer=50, kind="close")
    first = visits(fault)
    assert any(isinstance(measured, str) for *_, measured in first), "the fault was met"
    assert visits(fault) == first


def run_of(folder):
    """Records of a run, but for the stamps of the wall clock."""
    assert run_command(["run", str(folder), "--yes"]) == 0
    with read_journal(folder / "campaign.db") as journal:
        return [(entry.number, entry.series, repr(entry.record)) for entry in journal.records()]


@pytest.mark.long
def test_two_runs_of_one_seed_give_the_same_journal_record_for_record(tmp_path, capsys):
    folder, again = tmp_path / "first", tmp_path / "second"
    assert run_command(["new", str(folder), "--scenario", "paper-simulation"]) == 0
    change(folder / "campaign.yaml", FEW_SHOTS)
    change(folder / "cell.yaml", {"speed_up": 10_000, "faults": TROUBLES})
    assert run_command(["plan", str(folder), "--placement", "boundary"]) == 0
    shutil.copytree(folder, again)
    threads = threading.active_count()
    first = run_of(folder)
    assert sum("reconnected" in record for *_, record in first) >= 2, "the troubles were met"
    assert run_of(again) == first
    assert threading.active_count() == threads
    capsys.readouterr()
