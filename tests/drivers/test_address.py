"""A device's URL, read or refused with its reason."""

import pytest

from drivers.errors import AddressInvalid
from drivers.transport import parse_address


@pytest.mark.parametrize(
    ("url", "address"),
    [
        ("tcp://robot.local:5020", ("tcp", "robot.local", 5020)),
        ("tcp://[::1]:65535", ("tcp", "::1", 65535)),
        ("serial:///dev/ttyUSB0", ("serial", "/dev/ttyUSB0", 115200)),
        ("serial:///dev/ttyUSB0?baud=9600", ("serial", "/dev/ttyUSB0", 9600)),
    ],
)
def test_address_is_read(url, address):
    assert parse_address(url) == address


@pytest.mark.parametrize(
    ("url", "reason"),
    [
        ("", "neither TCP nor serial"),
        ("http://robot:80", "neither TCP nor serial"),
        ("tcp://robot", "host or port is missing"),
        ("tcp://robot:65536", "range"),
        ("tcp://[::1:5020", "IPv6"),
        ("tcp://robot..local:5020", "cannot be a host's name"),
        ("tcp://me@robot:5020", "more than a host and a port"),
        ("tcp://robot:5020/arm", "more than a host and a port"),
        ("tcp://robot:5020?baud=9600", "more than a host and a port"),
        ("serial://ttyUSB0", "three slashes"),
        ("serial:///", "three slashes"),
        ("serial:///dev/ttyUSB0?bauds=9600", "'bauds' is not known"),
        ("serial:///dev/ttyUSB0?baud=fast", "baud is 'fast'"),
        ("serial:///dev/ttyUSB0?baud=" + "9" * 5000, "baud is"),
        ("serial:///dev/ttyUSB0?baud", "baud"),
    ],
)
def test_wrong_address_is_refused_with_its_reason_and_the_right_form(url, reason):
    with pytest.raises(AddressInvalid, match="use tcp://HOST:PORT or serial://") as refused:
        parse_address(url)
    assert reason in refused.value.problem
