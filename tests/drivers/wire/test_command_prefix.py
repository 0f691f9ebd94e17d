"""Commands that a campaign's files may name: ssh to a host, or one program."""

import pytest

from drivers.errors import AddressInvalid
from drivers.wire.command_prefix import command_prefix


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("", ()),
        ("ssh operator@controller", ("ssh", "operator@controller")),
        (" ssh  192.168.0.20 ", ("ssh", "192.168.0.20")),
        ("/opt/beside", ("/opt/beside",)),
        ("'/opt/my cell/beside'", ("/opt/my cell/beside",)),
    ],
)
def test_documented_commands_are_taken_apart(command, words):
    assert command_prefix(command) == words


@pytest.mark.parametrize(
    "command",
    [
        "sh -c 'touch /tmp/x'",
        "ssh -oProxyCommand=x host",
        "ssh -oProxyCommand=x",
        "ssh a@-oProxyCommand=x",
        "ssh host touch",
        "ssh 'host;x'",
        "ssh",
        "nsenter -t 1",
        "/bin/sh -c x",
        "./beside",
        "beside",
        "'",
    ],
)
def test_every_other_command_is_refused(command):
    with pytest.raises(AddressInvalid, match=r"none of those that .* → write ssh USER@HOST"):
        command_prefix(command)
