"""The byte log: every byte in its direction, readable, bounded, never in the way of the work."""

import io
import re
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st
from robotline_layouts import PAR4_LAYOUT, PAR4_LINES
from timed_pipe import HandClock, TimedPipe

from drivers.byte_log import ByteLog, LoggedTransport, bytes_as_lines, logged, no_reading
from drivers.catalog import CONTROLLERS, TRACKERS, controller_driver, tracker_driver
from drivers.errors import LinkDown
from drivers.wire import robotline
from drivers.wire.emscon import Answer, EmsconRequest, encode, refusal
from drivers.wire.emscon_constants import Command
from drivers.wire.emscon_messages import StatusChange, Units
from drivers.wire.robotline import ControllerStatus, Order

NOW = "2026-05-04T10:00:00.000Z"
READINGS = {name: tracker_driver(name).reading for name in TRACKERS} | {
    name: partial(controller_driver(name).reading, PAR4_LAYOUT) for name in CONTROLLERS
}


class Desk:
    """A log in memory, and a pipe that is written down in it."""

    def __init__(self, *said, reading=no_reading, **options):
        self.file = io.StringIO()
        self.log = ByteLog(self.file, now_utc=lambda: NOW, **options)
        self.clock = HandClock()
        self.pipe = TimedPipe(self.clock, lambda _: said)
        self.transport = logged(lambda **_: self.pipe, self.log, "tracker", reading)()

    def entries(self):
        """What was written below the heading."""
        lines = self.file.getvalue().splitlines()
        return [line for line in lines if not line.startswith("#")]


class TestLog:
    def test_both_directions_are_written_down_with_time_and_device(self):
        desk = Desk((0.1, b"pong\r\n"))
        desk.transport.send(b"ping\r\n", 1.0)
        assert desk.transport.receive(1.0) == b"pong\r\n"
        desk.transport.close()
        desk.transport.close()
        assert desk.entries() == [
            f"{NOW} tracker ! pipe://test: opened",
            f"{NOW} tracker > 6 bytes",
            r"    ping\r\n",
            f"{NOW} tracker < 6 bytes",
            r"    pong\r\n",
            f"{NOW} tracker ! pipe://test: closed by us",
        ]

    def test_silence_is_not_written_down(self):
        desk = Desk()
        assert desk.transport.receive(1.0) == b""
        assert len(desk.entries()) == 1

    def test_each_entry_of_either_device_is_in_the_file_before_work_goes_on(self, tmp_path):
        path = tmp_path / "spy.log"
        with path.open("w", encoding="utf-8") as file:
            ByteLog(file, now_utc=lambda: NOW).enter("tracker", ">", "3 bytes", ["abc"])
            assert "abc" in path.read_text(encoding="utf-8")
        desk = Desk()
        other = LoggedTransport(TimedPipe(HandClock()), desk.log, "controller", no_reading())
        desk.transport.send(b"1", 1.0)
        other.send(b"2", 1.0)
        assert [line.split()[1] for line in desk.entries()[1::2]] == ["tracker", "controller"]

    def test_failures_of_the_wire_are_written_down_and_passed_on(self):
        desk = Desk((0.1, b""))
        desk.transport.send(b"x", 1.0)
        with pytest.raises(LinkDown, match="closed the connection"):
            desk.transport.receive(1.0)
        desk.pipe.close()
        with pytest.raises(LinkDown):
            desk.transport.send(b"y", 1.0)
        assert [line for line in desk.entries() if " ! " in line][1:] == [
            f"{NOW} tracker ! pipe://test: the device closed the connection",
            f"{NOW} tracker ! pipe://test: closed",
        ]
        assert "    y" in desk.entries()

    def test_pipe_that_cannot_be_opened_is_written_down(self):
        file = io.StringIO()

        def refuse(**_):
            raise LinkDown("tcp://10.0.0.1:700: nobody answers", remedy="-")

        log = ByteLog(file, now_utc=lambda: NOW)
        with pytest.raises(LinkDown):
            logged(refuse, log, "tracker", no_reading)()
        assert "tracker ! tcp://10.0.0.1:700: nobody answers\n" in file.getvalue()


class TestBounds:
    def test_log_ends_at_its_largest_size_or_a_full_disk_and_the_work_goes_on(self):
        desk = Desk(limit_characters=1000)
        for _ in range(100):
            desk.transport.send(b"x" * 100, 1.0)
        assert len(desk.pipe.sent) == 100
        text = desk.file.getvalue()
        assert len(text) < 1100
        assert text.endswith("# The log ends here: it has reached its largest size.\n")
        assert desk.log.problem == "it has reached its largest size"
        desk = Desk()

        def full(text):
            raise OSError(28, "No space left on device")

        desk.file.write = full
        desk.transport.send(b"x", 1.0)
        assert desk.pipe.sent == [b"x"]
        assert desk.log.problem == "it cannot be written (No space left on device)"

    def test_long_piece_is_cut_and_counted(self):
        lines = bytes_as_lines(b"a" * 10_000)
        assert lines == ["a" * 4096, "… and 5904 bytes more"]


class TestBytes:
    def test_text_stays_text_anything_else_is_in_hexadecimal_and_long_pieces_are_cut(self):
        assert bytes_as_lines(b"one\r\ntwo\ta\\b\n") == [r"one\r\n", r"two\ta\\b\n"]
        line, following = bytes_as_lines(b"\x00AT401\xff" + bytes(20))
        assert line.startswith("0000  00 41 54 34 30 31 ff ")
        assert " .AT401." in line
        assert following.startswith("0010  00 "), "numbered by its first byte"

    @given(st.binary(min_size=1, max_size=4096))
    def test_no_byte_is_lost(self, data):
        lines = bytes_as_lines(data)
        if re.fullmatch(rb"[\t\n\r -~]*", data):
            shown = re.sub(r"\\(.)", _unescaped, "".join(lines)).encode("ascii")
        else:
            shown = b"".join(bytes.fromhex(line[6:53]) for line in lines)
        assert shown == data

    @given(st.binary(max_size=5000))
    def test_every_line_can_be_printed(self, data):
        assert all(line.isprintable() for line in bytes_as_lines(data))


def _unescaped(found):
    return {"r": "\r", "n": "\n", "t": "\t"}.get(found[1], found[1])


class TestEmsconReading:
    def test_packets_are_read_in_both_directions_with_the_words_of_refusals(self):
        reading = READINGS["emscon"]()
        assert reading.sent(encode(EmsconRequest(Command.SET_UNITS, Units(1, 1, 0, 0, 0)))) == [
            "SetUnits Units(length=1, angle=1, temperature=0, pressure=0, humidity=0)"
        ]
        said = encode(Answer(Command.SET_UNITS)) + encode(StatusChange(6))
        assert reading.received(said) == [
            "answer to SetUnits: Nothing()",
            "unasked: StatusChange(code=6)",
        ]
        (said,) = READINGS["emscon"]().received(refusal(Command.START_MEASUREMENT, 39))
        assert said.endswith("emScon error 39 (tracker not initialized)")

    def test_stream_is_read_packet_by_packet_until_it_has_lost_its_step(self):
        reading, packet = READINGS["emscon"](), encode(EmsconRequest(Command.GET_UNITS))
        assert reading.sent(packet[:5]) == []
        assert len(reading.sent(packet[5:])) == 1
        reading = READINGS["emscon"]()
        (said,) = reading.received(b"\xff" * 20)
        assert said.startswith("cannot be read, nor what follows: a packet claims")
        assert reading.received(encode(Answer(Command.SET_UNITS))) == ()


class TestLineReadings:
    def test_robotline_is_read_in_both_directions(self):
        reading = READINGS["robotline"]()
        question = PAR4_LINES.encode_request(robotline.RobotlineRequest(8, Order.STATE))
        status = ControllerStatus(moving=False, emergency_stop=True, fault="", joints=(1.0,) * 4)
        answer = PAR4_LINES.encode_reply(robotline.RobotlineReply(8, "STATE", status))
        assert reading.sent(question) == ["question 8: Order.STATE"]
        (said,) = reading.received(answer)
        assert said.startswith("answer 8 to STATE: ControllerStatus(moving=False")

    def test_line_that_cannot_be_read_says_why_and_the_next_one_is_read(self):
        reading = READINGS["robotline"]()
        said = reading.received(b"garbage\r\n\r\nmore\n")
        assert len(said) == 2
        assert all(line.startswith("cannot be read: ") for line in said)


class TestAnyReading:
    @pytest.mark.slow
    @pytest.mark.parametrize("driver", list(READINGS))
    @given(pieces=st.lists(st.binary(max_size=100), max_size=10))
    def test_garbage_raises_nothing(self, driver, pieces):
        reading = READINGS[driver]()
        for piece in pieces:
            for line in [*reading.sent(piece), *reading.received(piece)]:
                assert len(line) <= 500

    def test_protocol_without_a_grammar_is_bytes_alone(self):
        reading = READINGS["linuxcnc"]()
        assert (reading.sent(b"hello\n"), reading.received(b"ACK\n")) == ((), ())
