"""Scripted faults of the wire: what each does to a message."""

import pytest
from timed_pipe import HandClock

from drivers.errors import WireError
from sim.faults import Counted, Fault, FaultScript
from sim.servers.conversation import GARBLED, LATE_S, Conversation, ServedSession

MESSAGE = b"0123456789\n"


class Echo(ServedSession):
    """Says what it hears."""

    def __init__(self, send):
        self.send = send

    def received(self, data, now_s):
        if data == b"no such word":
            raise WireError("no such word")
        self.send(data)

    def closed(self, now_s):
        pass


class Talk:
    """A conversation at times that a test chooses."""

    def __init__(self, *faults):
        script = FaultScript([Fault(Counted.TRACKER_ANSWER, *fault) for fault in faults], {})
        self.clock = HandClock()
        self.conversation = Conversation(
            lambda send, _: Echo(send),
            0,
            lambda: script.next(Counted.TRACKER_ANSWER),
            self.clock.now_s,
        )

    def put(self, message, now_s):
        self.clock.time_s = now_s
        self.conversation.hear(message)

    def taken(self, now_s):
        self.clock.time_s = now_s
        data = self.conversation.going()
        self.conversation.gone(len(data))
        return data


def test_what_could_not_be_written_stays_first():
    talk = Talk()
    talk.put(b"abcdef", 0.0)
    assert talk.conversation.going() == b"abcdef"
    talk.conversation.gone(2)
    talk.put(b"gh", 0.0)
    assert talk.conversation.going() == b"cdefgh"


GARBLED_MESSAGE = MESSAGE[:-1].translate(GARBLED) + b"\n"


@pytest.mark.parametrize(
    ("fault", "at_once", "later"),
    [
        (("silent", None), b"two", b""),
        (("torn", None), b"01234two", b""),
        (("torn", 2.0), b"01234", b"56789\ntwo"),
        (("garbage", None), GARBLED_MESSAGE + b"two", b""),
    ],
)
def test_a_fault_hits_one_message_and_the_next_one_follows_whole(fault, at_once, later):
    talk = Talk((1, *fault))
    talk.put(MESSAGE, 0.0)
    talk.put(b"two", 0.0)
    assert talk.taken(1.9) == at_once
    assert talk.taken(2.0) == later
    assert talk.conversation.size_bytes == 0
    assert not set(GARBLED_MESSAGE[:-1]) & set(MESSAGE)


def test_bytes_that_are_not_of_the_protocol_end_the_conversation():
    talk = Talk()
    talk.put(b"no such word", 0.0)
    assert talk.conversation.is_over


@pytest.mark.parametrize(("seconds", "late_s"), [(5.0, 5.0), (None, LATE_S)])
def test_a_late_answer_holds_up_the_following_ones(seconds, late_s):
    talk = Talk((1, "late", seconds))
    talk.put(b"one", 10.0)
    talk.put(b"two", 11.0)
    assert talk.taken(10.0 + 0.99 * late_s) == b""
    assert talk.conversation.next_due_s() == 10.0 + late_s
    assert talk.taken(10.0 + late_s) == b"onetwo"


def test_close_ends_the_connection_after_what_was_said_before():
    talk = Talk((2, "close", None))
    for message in (b"one", b"two", b"three"):
        talk.put(message, 0.0)
    assert talk.taken(0.0) == b"one"
    assert talk.conversation.wants_close
