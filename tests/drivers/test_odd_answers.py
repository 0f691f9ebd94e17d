"""Sound packets with odd contents, to any question: the driver raises its own errors only.

Lines have no odd contents: their grammar or bounds refuse them.
"""

import math
from collections import Counter
from random import Random

import pytest
from scripted_emscon import Instrument, Station

from drivers.errors import DriverError
from drivers.wire.emscon import ANSWERS, Answer
from drivers.wire.emscon_messages import SingleResult2, Triple, annotations_of

WHOLES = (0, 1, -1, 2, 3, 5, 39, 70, 2048, 10011, 2**31 - 1, -(2**31))
FLOATS = (0.0, 1.0, -1.0, 20.0, 1013.0, 0.01, 1e-300, 1e300, math.nan, math.inf, -math.inf)
TEXTS = ("", "CCR-1.5in", "\x1b[31m", "x" * 31, "\u202e")


def odd(kind, draw):
    """A body of that kind with any values."""
    one = {
        int: lambda: draw.choice(WHOLES),
        float: lambda: draw.choice(FLOATS),
        Triple: lambda: tuple(draw.choice(FLOATS) for _ in range(3)),
        str: lambda: draw.choice(TEXTS),
    }
    return kind(*(one[form]() for form in annotations_of(kind)))


def ends_of_calls(draw):
    """How calls end, by the name of what they raise; only a driver's own errors are caught."""
    instrument = Instrument()
    for command, kind in ANSWERS.items():
        if draw.random() < 0.1:
            instrument.says[command] = [(0.0, Answer(command, 0, odd(kind, draw)))]
    if draw.random() < 0.5:
        instrument.result = odd(SingleResult2, draw)
    tracker, ends = Station(instrument).tracker, Counter()
    for call in (
        tracker.connect,
        lambda: tracker.prepare("CCR-1.5in", 0.5),
        tracker.state,
        tracker.weather,
        tracker.reflectors,
        tracker.measure,
        lambda: tracker.go_to((1.0, 2.0, 3.0)),
        tracker.reconnect,
        tracker.close,
    ):
        try:
            call()
        except DriverError as error:
            ends[type(error).__name__] += 1
        else:
            ends["done"] += 1
    return ends


@pytest.mark.slow
def test_odd_answer_ends_in_an_error_of_the_drivers_or_in_none():
    ends = sum((ends_of_calls(Random(seed)) for seed in range(15)), Counter())
    assert ends["done"] > 15
    assert len(ends) > 3, "several kinds of errors"
