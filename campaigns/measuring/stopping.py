"""Stopping: whatever ends a block that moves the robot, the robot is stopped first."""

from collections.abc import Iterator
from contextlib import contextmanager

from campaigns.measuring.run_state import EngineState, RunState
from campaigns.measuring.series_log import problem_of
from drivers.errors import RobotStateUnknown
from drivers.ports import RobotController


@contextmanager
def stopping_robot(robot: RobotController, run_state: RunState) -> Iterator[None]:
    """Stop the robot first if anything goes wrong, then raise the error again.

    Raise `RobotStateUnknown` if the stop fails.
    """
    try:
        yield
    except BaseException as error:  # also Ctrl-C, and errors of this program
        _stop(robot, run_state, error)
        raise


def _stop(robot: RobotController, run_state: RunState, because: BaseException) -> None:
    """Stop the robot; raise `RobotStateUnknown` if the stop fails."""
    # A stop that fails outranks the error that led to it: someone may be about to step into the
    # cell. The first error is named in the text, the failed stop is the cause.
    try:
        _retry_stop(robot)
    except BaseException as error:
        raise RobotStateUnknown(
            f"robot state unknown: the stop failed ({problem_of(error)}), "
            f"after: {problem_of(because)}",
            remedy="use the hardware stop",
        ) from error
    finally:
        run_state.enter(EngineState.STOPPED)


def _retry_stop(robot: RobotController) -> None:
    """Stop the robot, and once more if Ctrl-C cuts the first stop off."""
    try:
        robot.stop()
    except KeyboardInterrupt:
        robot.stop()
