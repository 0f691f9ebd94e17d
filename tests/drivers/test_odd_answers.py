"""Sound frames with odd contents, to any question: every driver raises its own errors only."""

import math
from collections import Counter
from random import Random

import pytest
from scripted_controller import ScriptedController
from scripted_emscon import Instrument, Station

from drivers.errors import DriverError
from drivers.values import Pose
from drivers.wire.emscon import ANSWERS, Answer
from drivers.wire.emscon_messages import SingleResult2, Triple, annotations_of

WHOLES = (0, 1, -1, 2, 3, 5, 39, 70, 2048, 10011, 2**31 - 1, -(2**31))
FLOATS = (0.0, 1.0, -1.0, 20.0, 1013.0, 0.01, 1e-300, 1e300, math.nan, math.inf, -math.inf)
TEXTS = ("", "CCR-1.5in", "\x1b[31m", "x" * 31, "\u202e")
ROBOTLINE_NUMBERS = ("0.0", "90.0", "361.0", "1.0e7", "1.0e300", "-1.0e300", "nan", "1", "x")


def endings(calls):
    """How calls end, by the name of what they raise; only a driver's own errors are caught."""
    ends = Counter()
    for call in calls:
        try:
            call()
        except DriverError as error:
            ends[type(error).__name__] += 1
        else:
            ends["done"] += 1
    return ends


def odd(kind, draw):
    """A body of that kind with any values."""
    one = {
        int: lambda: draw.choice(WHOLES),
        float: lambda: draw.choice(FLOATS),
        Triple: lambda: tuple(draw.choice(FLOATS) for _ in range(3)),
        str: lambda: draw.choice(TEXTS),
    }
    return kind(*(one[form]() for form in annotations_of(kind)))


def emscon_calls(draw):
    instrument = Instrument()
    for command, kind in ANSWERS.items():
        if draw.random() < 0.1:
            body = odd(kind, draw)
            instrument.says[command] = [(0.0, Answer(command, 0, body))]
    if draw.random() < 0.5:
        instrument.result = odd(SingleResult2, draw)
    return tracker_calls(Station(instrument).tracker)


def tracker_calls(tracker):
    return (
        tracker.connect,
        lambda: tracker.prepare("CCR-1.5in", 0.5),
        tracker.state,
        tracker.weather,
        tracker.reflectors,
        tracker.measure,
        lambda: tracker.go_to((1.0, 2.0, 3.0)),
        tracker.reconnect,
        tracker.close,
    )


def robot_calls(robot):
    return (
        robot.connect,
        robot.prepare,
        robot.state,
        lambda: robot.move_joints([0.1] * 4, 0.5),
        robot.state,
        lambda: robot.move_pose(Pose(0.0, 0.0, 0.0, 0.0), 1.0),
        robot.stop,
        robot.reconnect,
        robot.close,
    )


def robotline_calls(draw):
    controller = ScriptedController()
    numbers = " ".join(draw.choice(ROBOTLINE_NUMBERS) for _ in range(draw.choice((4, 4, 4, 3, 5))))
    controller.answers["STATE"] = [
        f"OK 0 {draw.choice('012')} - {numbers}",
        "OK 0 0 - 0.0 0.0 0.0 0.0",
    ]
    if draw.random() < 0.3:
        verb = draw.choice(("HELLO", "MOVEJ", "STOP"))
        controller.answers[verb] = draw.choice(("NO BUSY", "OK", "OK 1.0e300", "NO X y"))
    return robot_calls(controller.robot)


@pytest.mark.slow
@pytest.mark.parametrize("calls_of", [emscon_calls, robotline_calls])
def test_odd_answer_ends_in_an_error_of_the_drivers_or_in_none(calls_of):
    ends = Counter()
    for seed in range(15):
        ends += endings(calls_of(Random(seed)))
    assert ends["done"] > 15
    assert len(ends) > 3, "several kinds of errors"
