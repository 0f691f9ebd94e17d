"""What every driver does alike: before it is connected, in silence, at a wish to stop, anew."""

import pytest
from scripted_controller import ANSWERS, ScriptedController
from scripted_emscon import Station, system_status
from scripted_pointline import ScriptedInstrument

from drivers.errors import Cancelled, LinkDown, WrongDevice
from drivers.wire.emscon_constants import Command


class Robotline:
    def __init__(self, **options):
        self.end = ScriptedController(**options)
        self.device = self.end.robot

    def is_silent(self, silent=True):
        self.end.answers["STATE"] = None if silent else ANSWERS["STATE"]

    def is_another(self, another=True):
        serial = "4711" if another else "SN-0042"
        self.end.answers["HELLO"] = f"OK 1 Example%20Robotics Par4 {serial} 2.1 4"


class Emscon:
    def __init__(self, **options):
        self.end = Station(**options)
        self.device = self.end.tracker

    def is_silent(self, silent=True):
        self.end.instrument.says = {Command.GET_SYSTEM_STATUS: []} if silent else {}

    def is_another(self, another=True):
        status = system_status(serial=4711) if another else system_status()
        self.end.instrument.state[Command.GET_SYSTEM_STATUS] = status


class Pointline:
    def __init__(self, **options):
        self.end = ScriptedInstrument(**options)
        self.device = self.end.tracker

    def is_silent(self, silent=True):
        self.end.answers["STATE"] = None if silent else "OK 0 1 1 1 CCR-1.5in"

    def is_another(self, another=True):
        serial = "815-4711" if another else "4711"
        self.end.answers["HELLO"] = f"OK 1 Example%20Metrology T-1000 {serial} 2.1"


pytestmark = pytest.mark.parametrize("far", [Robotline, Emscon, Pointline])


def connected(far, **options):
    far = far(**options)
    far.device.connect()
    return far


def test_nothing_works_before_connecting(far):
    for call in (far().device.state, far().device.identity):
        with pytest.raises(LinkDown, match="not connected"):
            call()


def test_silence_closes_the_wire_until_it_is_opened_anew(far):
    far = connected(far)
    far.is_silent()
    with pytest.raises(LinkDown, match="no answer to"):
        far.device.state()
    assert far.end.pipes[-1].is_closed
    far.is_silent(False)
    with pytest.raises(LinkDown, match="not connected"):
        far.device.state()
    far.device.reconnect()
    assert far.device.state()
    far.device.close()
    far.device.close()
    assert all(pipe.is_closed for pipe in far.end.pipes)


def test_another_device_after_a_reconnection_is_refused_and_the_first_known_again(far):
    far = connected(far)
    identity = far.device.identity()
    far.is_another()
    with pytest.raises(WrongDevice, match=rf"4711.*it was.*{identity.serial}"):
        far.device.reconnect()
    assert far.end.pipes[-1].is_closed
    far.is_another(False)
    far.device.reconnect()
    assert far.device.state()


def test_wish_to_stop_abandons_a_question_and_closes_the_wire(far):
    wishes = []
    far = connected(far, cancelled=lambda: bool(wishes))
    wishes.append("stop")
    with pytest.raises(Cancelled):
        far.device.state()
    assert far.end.pipes[-1].is_closed


def test_interrupted_greeting_leaves_no_connection_open(far):
    def interrupt(*_):
        raise KeyboardInterrupt

    far = far()
    far.end.respond = interrupt
    with pytest.raises(KeyboardInterrupt):
        far.device.connect()
    assert all(pipe.is_closed for pipe in far.end.pipes)
    assert far.end.pipes
