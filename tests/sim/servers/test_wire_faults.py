"""Scripted faults: counted over restarts, each once, and what each does to a message."""

import pytest

from sim.faults import Counted, Fault, FaultScript
from sim.servers.peers import GARBLED, LATE_S, SendQueue

MESSAGE = b"0123456789\n"


def outbox(*faults):
    script = FaultScript([Fault(Counted.TRACKER_ANSWER, *fault) for fault in faults], {})
    return SendQueue(lambda: script.next(Counted.TRACKER_ANSWER))


def taken(box, now_s):
    data = box.due(now_s)
    box.written(len(data))
    return data


def test_a_fault_comes_at_its_number_and_only_once():
    script = FaultScript([Fault(Counted.MOVE, 3, "stall", None)], {})
    assert [script.next(Counted.MOVE) is not None for _ in range(6)] == [0, 0, 1, 0, 0, 0]


def test_each_kind_is_counted_by_itself():
    script = FaultScript([Fault(Counted.MOVE, 1, "stall", None)], {})
    assert script.next(Counted.MEASUREMENT) is None
    assert script.next(Counted.MOVE) is not None


def test_counting_goes_on_after_a_restart():
    faults = [Fault(Counted.MOVE, 2, "stall", None)]
    first = FaultScript(faults, {})
    first.next(Counted.MOVE)
    second = FaultScript(faults, first.memory())
    assert second.next(Counted.MOVE) is not None
    assert FaultScript(faults, second.memory()).next(Counted.MOVE) is None


def test_without_faults_messages_go_out_at_once_and_in_order():
    box = outbox()
    box.put(b"one", 0.0)
    box.put(b"two", 0.0)
    assert taken(box, 0.0) == b"onetwo"
    assert box.size_bytes == 0
    assert box.next_due_s() is None


def test_what_could_not_be_written_stays_first():
    box = outbox()
    box.put(b"abcdef", 0.0)
    assert box.due(0.0) == b"abcdef"
    box.written(2)
    box.put(b"gh", 0.0)
    assert box.due(0.0) == b"cdefgh"


@pytest.mark.parametrize(("seconds", "late_s"), [(5.0, 5.0), (None, LATE_S)])
def test_a_late_answer_holds_up_the_following_ones(seconds, late_s):
    box = outbox((1, "late", seconds))
    box.put(b"one", 10.0)
    box.put(b"two", 11.0)
    assert taken(box, 10.0 + 0.99 * late_s) == b""
    assert box.next_due_s() == 10.0 + late_s
    assert taken(box, 10.0 + late_s) == b"onetwo"


def test_a_silent_answer_never_comes():
    box = outbox((1, "silent", None))
    box.put(b"one", 0.0)
    box.put(b"two", 0.0)
    assert taken(box, 1e9) == b"two"


def test_garbage_is_of_the_same_length_and_ends_the_line():
    box = outbox((1, "garbage", None))
    box.put(MESSAGE, 0.0)
    data = taken(box, 0.0)
    assert len(data) == len(MESSAGE)
    assert data.endswith(b"\n")
    assert data[:-1].translate(GARBLED) == MESSAGE[:-1]
    assert not set(data[:-1]) & set(MESSAGE)


def test_a_torn_answer_stops_in_the_middle():
    box = outbox((1, "torn", None))
    box.put(MESSAGE, 0.0)
    assert taken(box, 1e9) == b"01234"


def test_a_torn_answer_may_be_completed_later():
    box = outbox((1, "torn", 2.0))
    box.put(MESSAGE, 0.0)
    assert taken(box, 1.9) == b"01234"
    assert taken(box, 2.0) == b"56789\n"


def test_close_ends_the_connection_after_what_was_said_before():
    box = outbox((2, "close", None))
    for message in (b"one", b"two", b"three"):
        box.put(message, 0.0)
    assert taken(box, 0.0) == b"one"
    assert box.wants_close
