"""Whatever goes wrong, the robot is stopped, and loudly so when that fails."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from fake_cell import COVARIANCE_MM2, PATIENCE_S, FakeCell
from small_plans import work
from tested_journal import TestedJournal, journal_in

from campaigns.errors import Interrupted, JournalFailed, NotSettled
from campaigns.journal.records import Outcome, Rejected, SessionStopped
from campaigns.measuring.run_state import EngineState
from campaigns.measuring.work import RawReaders
from drivers import errors

POLL_S = 0.02
Break = Callable[[FakeCell], None]


def press_emergency_stop(cell: FakeCell) -> None:
    cell.robot.emergency_stop = True


def fault(cell: FakeCell) -> None:
    cell.robot.fault = "following error, joint 2"


def lose_the_robot(cell: FakeCell) -> None:
    cell.robot.state_errors = [errors.LinkDown("no answer", remedy="check the cable")]


def hold_the_arm(cell: FakeCell) -> None:
    cell.robot.joints = cell.robot.joints - 0.01


def raises(error: BaseException) -> Break:
    def act(cell: FakeCell) -> None:
        raise error

    return act


MOVING = {
    "e-stop": (press_emergency_stop, errors.EmergencyStop, "the emergency stop is pressed"),
    "drive fault": (fault, errors.MotionFault, "following error, joint 2"),
    "lost link": (lose_the_robot, errors.LinkDown, "no answer"),
    "held arm": (hold_the_arm, NotSettled, "joint 0 is 0.5730° from its target"),
}
MEASURING = {
    "e-stop": MOVING["e-stop"],
    "tracker gone": (
        raises(errors.LinkDown("no answer", remedy="check the cable")),
        errors.LinkDown,
        "no answer",
    ),
    "bug": (raises(ZeroDivisionError("a bug")), ZeroDivisionError, "a bug"),
    "impatient operator": (raises(KeyboardInterrupt()), KeyboardInterrupt, "^$"),
}


def assert_stopped_in_order(cell: FakeCell, journal: TestedJournal, how: str) -> None:
    """The robot first, then the journal: the attempt that was begun, and the session."""
    assert cell.calls[-3:] == [
        ("robot.stop",),
        ("journal.rejected", 1, 1),
        ("journal.session-stopped",),
    ]
    assert cell.observer.told[-1].state is EngineState.STOPPED
    *_, rejected, stopped = (entry.record for entry in journal.records())
    assert isinstance(stopped, SessionStopped)
    assert isinstance(rejected, Rejected)
    assert (stopped.how, stopped.reason) == (how, rejected.reason)


@pytest.mark.parametrize(
    ("moment", "trouble"),
    [*(("moving", name) for name in MOVING), *(("measuring", name) for name in MEASURING)],
)
def test_trouble_stops_the_robot_and_drops_the_shot(
    tmp_path: Path, moment: str, trouble: str
) -> None:
    break_it, error, text = (MOVING if moment == "moving" else MEASURING)[trouble]
    cell = FakeCell()
    acts = cell.robot.during_move if moment == "moving" else cell.tracker.during_measure
    acts[2] = lambda: break_it(cell)
    with journal_in(tmp_path, cell.calls) as journal:
        with pytest.raises(error, match=text):
            cell.measure(journal, work())
        how = "interrupted" if error is KeyboardInterrupt else "aborted"
        assert_stopped_in_order(cell, journal, how)
        assert [entry.record.shot for entry in journal.records_of(Outcome)] == [0]


@pytest.mark.parametrize(
    ("part", "misread_by"), [("joints", 1e-9), ("point_mm", 1e-6), ("covariance_mm2", 1e-6)]
)
def test_a_shot_that_is_not_what_the_raw_answers_say_stops_the_robot(
    tmp_path: Path, part: str, misread_by: float
) -> None:
    cell, off = FakeCell(), dict.fromkeys(("joints", "point_mm", "covariance_mm2"), 0.0)

    def read_point(_raw: str) -> tuple[np.ndarray, np.ndarray]:
        point_mm = np.array(cell.tracker.seen_mm()) + off["point_mm"]
        return point_mm, np.array(COVARIANCE_MM2) + off["covariance_mm2"]

    cell.raw_readers = RawReaders(lambda _raw: cell.robot.joints + off["joints"], read_point)
    cell.tracker.during_measure = {2: lambda: off.update({part: misread_by})}
    with journal_in(tmp_path, cell.calls) as journal:
        with pytest.raises(errors.ImplausibleAnswer, match=f"shot 1: {part} .* raw answer says"):
            cell.measure(journal, work())
        assert_stopped_in_order(cell, journal, "aborted")
        assert [entry.record.shot for entry in journal.records_of(Outcome)] == [0]


def test_robot_that_refuses_one_target_after_another_is_stopped(tmp_path: Path) -> None:
    cell = FakeCell()

    def refuse(*_: object) -> None:
        raise errors.LimitViolation("joint 1 outside", remedy="compare limits")

    cell.tracker.during_measure = {1: lambda: setattr(cell.robot, "move_joints", refuse)}
    with journal_in(tmp_path, cell.calls) as journal:
        with pytest.raises(errors.LimitViolation, match="joint 1 outside"):
            cell.measure(journal, work())
        rejected = [(e.record.shot, e.record.reason) for e in journal.records_of(Rejected)]
        stopped = journal.records()[-1].record
    assert rejected == [(shot, "joint 1 outside") for shot in (1, 3, 5)]
    assert cell.calls[-2:] == [("robot.stop",), ("journal.session-stopped",)]
    assert (stopped.how, stopped.reason) == ("aborted", "joint 1 outside")


@pytest.mark.parametrize(
    ("state", "error", "within_s"),
    [
        (EngineState.MOVING, Interrupted, POLL_S),
        (EngineState.SETTLING, Interrupted, POLL_S),
        (EngineState.MEASURING, errors.Cancelled, PATIENCE_S),
    ],
)
def test_ctrl_c_stops_the_robot_at_once(
    tmp_path: Path, state: EngineState, error: type[Exception], within_s: float
) -> None:
    cell = FakeCell()

    def press_soon_after_arrival() -> None:
        cell.clock.after(cell.robot._ends_s - cell.clock.now_s() + 0.1, cell.wish.ask)

    match state:
        case EngineState.MOVING:
            cell.robot.during_move = {2: cell.wish.ask}
        case EngineState.SETTLING:
            cell.robot.during_move = {2: press_soon_after_arrival}
        case EngineState.MEASURING:
            cell.tracker.during_measure = {2: cell.wish.ask}
    with journal_in(tmp_path, cell.calls) as journal:
        with pytest.raises(error):
            cell.measure(journal, work())
        assert_stopped_in_order(cell, journal, "interrupted")
    assert cell.observer.told[-2].state is state
    assert cell.robot.stopped_s - cell.wish.asked_s <= within_s + 1e-9


def test_ctrl_c_before_the_first_motion_lets_nothing_move(tmp_path: Path) -> None:
    cell = FakeCell()
    cell.wish.ask()
    with journal_in(tmp_path, cell.calls) as journal, pytest.raises(Interrupted):
        cell.measure(journal, work())
    assert not cell.named("robot.move_joints")


RECORDS_OF_EACH_KIND = (3, 4, 5, 13, 14, 15)


@pytest.mark.parametrize("record", RECORDS_OF_EACH_KIND)
def test_journal_that_cannot_be_written_stops_the_robot_and_ends_all_motion(
    tmp_path: Path, record: int
) -> None:
    cell = FakeCell()
    with journal_in(tmp_path, cell.calls) as journal:
        journal.fails_from = record
        with pytest.raises(JournalFailed, match="the disk is full"):
            cell.measure(journal, work())
    assert cell.calls[-1] == ("robot.stop",)
    writes = [place for place, call in enumerate(cell.calls) if call[0].startswith("journal.")]
    after_the_last_write = [call[0] for call in cell.calls[writes[-1] :]]
    assert after_the_last_write.count("robot.move_joints") <= 1


STOP_FAILURES = {
    "no confirmation": [
        errors.RobotStateUnknown("robot state unknown: no answer", remedy="use it")
    ],
    "refused": [errors.MotionFault("brake does not close", remedy="call service")],
    "bug": [OSError("descriptor closed")],
    "interrupted twice": [KeyboardInterrupt(), KeyboardInterrupt()],
}


@pytest.mark.parametrize("failure", STOP_FAILURES)
def test_stop_that_fails_is_loud(tmp_path: Path, failure: str) -> None:
    cell = FakeCell()
    cell.robot.stop_errors = list(STOP_FAILURES[failure])
    cell.robot.during_move = {2: lambda: press_emergency_stop(cell)}
    with journal_in(tmp_path, cell.calls) as journal:
        with pytest.raises(
            errors.RobotStateUnknown, match=r"robot state unknown.*emergency"
        ) as caught:
            cell.measure(journal, work())
        stopped = journal.records_of(SessionStopped)[-1].record
    assert caught.value.remedy == "use the hardware stop"
    assert (stopped.how, stopped.reason) == ("aborted", caught.value.problem)


def test_ctrl_c_during_the_stop_does_not_keep_the_robot_from_stopping(tmp_path: Path) -> None:
    cell = FakeCell()
    cell.robot.stop_errors = [KeyboardInterrupt()]
    cell.robot.during_move = {2: cell.wish.ask}
    with journal_in(tmp_path, cell.calls) as journal, pytest.raises(Interrupted):
        cell.measure(journal, work())
    assert len(cell.named("robot.stop")) == 2
    assert cell.robot.stopped_s is not None


def test_journal_that_fails_does_not_hide_an_unknown_state_of_the_robot(tmp_path: Path) -> None:
    cell = FakeCell()
    cell.robot.stop_errors = [errors.LinkDown("no answer", remedy="check the cable")]
    with journal_in(tmp_path, cell.calls) as journal:
        journal.fails_from = 5
        with pytest.raises(errors.RobotStateUnknown, match=r"no answer.*the disk is full"):
            cell.measure(journal, work())
