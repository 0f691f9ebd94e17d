"""One question at a time: what counts as its answer, and what closes the link."""

import pytest
from timed_pipe import HandClock, TimedPipe

from drivers.errors import Cancelled, LinkDown, WireError
from drivers.link import EVENTS_KEPT, PATIENCE_S, Link
from drivers.wire.framing import LineFramer


def is_event(line: bytes) -> bool:
    return line.startswith(b"event")


def is_answer(line: bytes) -> bool:
    return line.startswith(b"answer")


def link_over(pipe, clock_s, cancelled=lambda: False):
    return Link(pipe, LineFramer(100).feed, clock_s=clock_s, is_event=is_event, cancelled=cancelled)


class Cell:
    """A link over a pipe whose other end does what the test says."""

    def __init__(self, *answers, cancelled=lambda: False):
        self.clock = HandClock()
        self.pipe = TimedPipe(self.clock, lambda _: answers)
        self.link = link_over(self.pipe, self.clock.now_s, cancelled)

    def ask(self, request=b"question\n", within_s=1.0):
        return self.link.ask(request, answers=is_answer, within_s=within_s, title="QUESTION")

    def assert_closed(self):
        assert not self.link.is_open
        assert self.pipe.is_closed
        with pytest.raises(LinkDown, match="closed"):
            self.ask()


def test_question_is_sent_and_its_answer_returned():
    cell = Cell((0.2, b"answer 1\n"))
    assert cell.ask() == b"answer 1"
    assert cell.pipe.sent == [b"question\n"]
    assert cell.clock.now_s() == pytest.approx(0.2)
    assert cell.link.is_open


@pytest.mark.parametrize("pause_s", [0.0, 0.5])
def test_late_answer_closes_the_link(pause_s):
    cell = Cell((1.1, b"answer to first\n"))
    with pytest.raises(LinkDown, match=r"no answer to QUESTION within 1 s"):
        cell.ask(b"first\n")
    cell.clock.sleep_s(pause_s)
    cell.assert_closed()
    assert cell.pipe.sent == [b"first\n"]


def test_answer_that_came_in_time_counts_even_if_looked_at_late():
    pipe = TimedPipe(HandClock(), lambda _: ((0.0, b"answer 1\n"),))
    question_and_awakening_s = iter([0.0, 2.0])
    link = link_over(pipe, lambda: next(question_and_awakening_s))
    assert link.ask(b"q\n", answers=is_answer, within_s=1.0, title="Q") == b"answer 1"


@pytest.mark.parametrize("said", [b"a", b"event\n"])
def test_deadline_counts_from_the_question_not_from_the_last_byte_or_event(said):
    cell = Cell(*((0.3 * n, said) for n in range(1, 20)))
    with pytest.raises(LinkDown):
        cell.ask()
    assert cell.clock.now_s() == pytest.approx(1.0)


@pytest.mark.parametrize("said", [b"answer 1\nanswer 1\n", b"something else\nanswer 1\n"])
def test_second_answer_or_one_of_another_kind_closes_the_link(said):
    cell = Cell((0.1, said))
    with pytest.raises(WireError, match="an unexpected message"):
        cell.ask()
    cell.assert_closed()


def test_answer_that_was_there_before_the_question_closes_the_link():
    cell = Cell()
    cell.pipe.arrives(0.0, b"answer 0\n")
    with pytest.raises(WireError, match="an unexpected message"):
        cell.ask()
    assert cell.pipe.sent == []
    cell.assert_closed()


def test_error_of_the_grammar_names_the_device_and_closes_the_link():
    def refuse(data):
        if data:
            raise WireError("garbage")
        return []

    cell = Cell((0.1, b"\xff\x00"))
    cell.link = Link(cell.pipe, refuse, clock_s=cell.clock.now_s, is_event=is_event)
    with pytest.raises(WireError, match="pipe://test: garbage"):
        cell.ask()
    assert cell.pipe.is_closed


def test_a_peer_that_closes_closes_the_link_whoever_asks():
    cell = Cell((0.1, b""))
    with pytest.raises(LinkDown, match="the device closed"):
        cell.ask()
    cell.assert_closed()
    cell = Cell()
    cell.pipe.arrives(0.0, b"")
    with pytest.raises(LinkDown):
        cell.link.events()
    cell.assert_closed()


def test_events_are_kept_in_order_and_read_without_waiting():
    cell = Cell((0.1, b"event 2\nanswer 1\nevent 3\n"))
    cell.pipe.arrives(0.0, b"event 1\n")
    assert cell.ask() == b"answer 1"
    assert cell.link.events() == [b"event 1", b"event 2", b"event 3"]
    assert cell.link.events() == []
    cell = Cell()
    cell.pipe.arrives(0.0, b"event 1\n")
    cell.pipe.arrives(0.5, b"event 2\n")
    assert cell.link.events() == [b"event 1"]
    assert cell.clock.now_s() == 0.0


def test_flood_of_events_is_bounded_and_the_newest_are_kept():
    count = EVENTS_KEPT + 5
    cell = Cell(*((0.0, b"event %d\n" % n) for n in range(count)), (0.1, b"answer 1\n"))
    assert not cell.link.take_lost_events()
    assert cell.ask() == b"answer 1"
    assert cell.link.take_lost_events()
    assert not cell.link.take_lost_events(), "once for each loss"
    kept = cell.link.events()
    assert len(kept) == EVENTS_KEPT
    assert kept[-1] == b"event %d" % (count - 1)


def test_event_is_found_or_waited_for_and_the_others_stay():
    cell = Cell((0.0, b"event 1\nevent 2\nanswer 1\n"))
    cell.ask()
    found = cell.link.await_event(lambda e: e == b"event 2", within_s=1.0, title="EVENT")
    assert found == b"event 2"
    assert cell.link.events() == [b"event 1"]
    cell = Cell()
    cell.pipe.arrives(0.7, b"event 1\n")
    assert cell.link.await_event(is_event, within_s=1.0, title="EVENT") == b"event 1"
    assert cell.clock.now_s() == pytest.approx(0.7)


def test_a_wish_to_stop_ends_the_wait_or_keeps_the_question_from_being_sent():
    clock_s = []
    cell = Cell(cancelled=lambda: bool(clock_s) and clock_s[0]() >= 0.3)
    clock_s.append(cell.clock.now_s)
    with pytest.raises(Cancelled, match="QUESTION was abandoned"):
        cell.ask(within_s=60.0)
    assert cell.clock.now_s() <= 0.3 + PATIENCE_S + 1e-9
    assert not cell.link.is_open
    cell = Cell((0.1, b"answer 1\n"), cancelled=lambda: True)
    with pytest.raises(Cancelled):
        cell.ask()
    assert cell.pipe.sent == []


def test_interrupt_closes_the_link():
    def interrupted(_):
        raise KeyboardInterrupt

    cell = Cell()
    cell.pipe.respond = interrupted
    with pytest.raises(KeyboardInterrupt):
        cell.ask()
    assert not cell.link.is_open
