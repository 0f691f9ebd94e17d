"""The wish to stop reaches the wire at once, whatever is pending on either link; loud if in vain.

Single tries, on machines that may be busy: benchmarks/torture/signals.py makes many.
"""

import signal
import time

import psutil
import pytest
from command_line import change, ended, started

from benchmarks.shared.relay import Relay
from sim.cell import Cell
from sim.clock import ScaledClock
from sim.embedded import EmbeddedCell
from sim.scenarios.scenario import load_scenario

PATIENCE_S = 30.0
AT_ONCE_S = 0.5
"""Far below the 2 s that the controller may take for an answer."""


class Stage:
    """A run on a cell behind relays, in a process of its own."""

    def __init__(self, controller, tracker, process):
        self.controller, self.tracker, self.process = controller, tracker, process

    def moving(self):
        self.controller.await_heard_s(b" MOVEJ ", within_s=PATIENCE_S)
        return self

    def measuring(self):
        moved_s = self.moving().controller.heard_s(b" MOVEJ ")
        self.tracker.await_heard_s(since_s=moved_s, within_s=PATIENCE_S)
        self.tracker.frozen = True
        return self

    def with_frozen_controller(self):
        self.moving().controller.frozen = True
        time.sleep(0.3)
        return self

    def with_slow_controller(self):
        self.moving().controller.delay_s = 0.8
        time.sleep(0.3)
        return self

    def stopped_by(self, number):
        """Signal, see STOP on the wire at once, and have the cell answer again."""
        asked_s = time.monotonic()
        self.process.send_signal(number)
        heard_s = self.controller.await_heard_s(b" STOP ", since_s=asked_s, within_s=PATIENCE_S)
        assert heard_s - asked_s <= AT_ONCE_S


@pytest.fixture
def stage(planned):
    cell = EmbeddedCell(Cell(load_scenario("paper-simulation")), ScaledClock(1.0))
    with cell, Relay(cell.controller_url) as controller, Relay(cell.tracker_url) as tracker:
        urls = {"controller.url": controller.url, "tracker.url": tracker.url}
        change(planned / "campaign.yaml", urls)
        process = started("run", planned, "--yes", process_group=0)
        try:
            yield Stage(controller, tracker, process)
        finally:
            process.kill()
            process.communicate()


@pytest.mark.parametrize(
    ("until", "number"),
    [
        pytest.param(Stage.moving, signal.SIGQUIT, marks=pytest.mark.long),
        pytest.param(Stage.measuring, signal.SIGTERM, marks=pytest.mark.long),
        (Stage.with_frozen_controller, signal.SIGINT),
        pytest.param(Stage.with_slow_controller, signal.SIGHUP, marks=pytest.mark.long),
    ],
)
def test_stop_is_on_the_wire_at_once_and_confirmed(stage, until, number):
    until(stage).stopped_by(number)
    stage.controller.frozen = False
    assert ended(stage.process, PATIENCE_S).code == 130


@pytest.mark.long
def test_ctrl_z_is_on_the_wire_at_once_and_suspends_only_after_the_stop(stage):
    stage.with_frozen_controller().stopped_by(signal.SIGTSTP)
    running = psutil.Process(stage.process.pid)
    time.sleep(0.3)
    assert running.status() != psutil.STATUS_STOPPED, "the stop is not confirmed yet"
    stage.controller.frozen = False
    give_up_s = time.monotonic() + PATIENCE_S
    while running.status() != psutil.STATUS_STOPPED:
        assert time.monotonic() < give_up_s
        time.sleep(0.01)
    stage.process.send_signal(signal.SIGCONT)
    assert ended(stage.process, PATIENCE_S).code == 130


@pytest.mark.parametrize(
    "number", [signal.SIGTERM, pytest.param(signal.SIGTSTP, marks=pytest.mark.long)]
)
def test_a_stop_that_nobody_confirms_says_first_what_to_do(stage, number):
    stage.with_frozen_controller().stopped_by(number)
    unknown = ended(stage.process, PATIENCE_S)
    assert unknown.code == 3
    assert unknown.error_line.startswith("PRESS THE EMERGENCY STOP: robot state unknown: ")
    lines = unknown.err.splitlines()
    alarm = "PRESS THE EMERGENCY STOP unless you see the robot stand"
    assert alarm in unknown.err.partition("\nPRESS THE EMERGENCY STOP\n")[0], "while it is tried"
    before = lines[: lines.index("PRESS THE EMERGENCY STOP")]
    assert not [line for line in before if line.startswith("run: ")], "nothing of how it ended"
