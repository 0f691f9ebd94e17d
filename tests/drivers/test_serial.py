"""A serial line as a byte pipe, over a pseudo-terminal."""

import os
import re
import time

import pytest

from drivers.errors import LinkDown
from drivers.transport import open_transport


class Device:
    """The far end of a serial line."""

    def __init__(self):
        self.fd, self._line = os.openpty()
        self.url = f"serial://{os.ttyname(self._line)}"
        self.is_there = True

    def says(self, data):
        os.write(self.fd, data)

    def hears(self):
        return os.read(self.fd, 65536)

    def unplug(self):
        """Be gone; a second time does nothing."""
        if self.is_there:
            os.close(self.fd)
            os.close(self._line)
        self.is_there = False


@pytest.fixture
def device():
    device = Device()
    yield device
    device.unplug()


@pytest.fixture
def ours(device):
    ours = open_transport(device.url, timeout_s=1.0)
    yield ours
    ours.close()


def received(transport, count):
    data = b""
    while len(data) < count:
        data += transport.receive(1.0)
    return data


def test_every_byte_passes_unchanged_both_ways(device, ours):
    every_byte = bytes(range(256))
    ours.send(every_byte, 1.0)
    assert device.hears() == every_byte
    device.says(every_byte)
    assert received(ours, 256) == every_byte


def test_what_waits_is_read_at_once(device, ours):
    device.says(b"one line\nand another\n")
    assert ours.receive(1.0) == b"one line\nand another\n"


def test_silence_is_no_bytes(ours):
    assert ours.receive(0.0) == b""
    assert ours.receive(0.002) == b""


def test_what_came_before_opening_is_thrown_away(device):
    first = open_transport(device.url, timeout_s=1.0)
    device.says(b"stale\n")
    first.close()
    second = open_transport(device.url, timeout_s=1.0)
    assert second.receive(0.002) == b""
    second.close()


def test_line_is_held_by_one_alone(device, ours):
    with pytest.raises(LinkDown, match="nobody else holds it"):
        open_transport(device.url, timeout_s=1.0)


def test_line_can_be_opened_again_after_closing(device, ours):
    ours.close()
    again = open_transport(device.url, timeout_s=1.0)
    again.send(b"hello\n", 1.0)
    assert device.hears() == b"hello\n"
    again.close()


def test_unplugged_device_breaks_the_pipe(device, ours):
    device.unplug()
    with pytest.raises(LinkDown, match="the line broke"):
        ours.receive(0.01)
    with pytest.raises(LinkDown, match="the line broke"):
        ours.send(b"x", 0.01)


def test_device_that_reads_nothing_breaks_the_pipe_in_time(ours):
    started_s = time.monotonic()
    with pytest.raises(LinkDown, match="the line broke"):
        ours.send(b"x" * 1_000_000, 0.005)
    assert time.monotonic() - started_s < 1.0


def test_closed_pipe_refuses_every_call(ours):
    ours.close()
    ours.close()
    with pytest.raises(LinkDown):
        ours.send(b"x", 1.0)
    with pytest.raises(LinkDown):
        ours.receive(1.0)


@pytest.mark.parametrize("path", ["/dev/there-is-no-such-line", "/dev/null", "/dev/nul\0l"])
def test_what_is_no_serial_line_is_said_with_its_name(path):
    shown = re.escape(path.replace("\0", "?"))
    with pytest.raises(LinkDown, match=f"serial://{shown}: cannot be opened"):
        open_transport(f"serial://{path}", timeout_s=1.0)


def test_pipe_is_named_by_its_address(device, ours):
    assert ours.name == device.url
