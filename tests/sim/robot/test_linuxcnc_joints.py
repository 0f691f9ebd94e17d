"""Joints from a real LinuxCNC, by its pins or by linuxcncrsh: only read, and read anew."""

import socket
import sys
from contextlib import closing, contextmanager
from math import radians
from threading import Thread

import pytest

from sim.robot import linuxcnc_joints
from sim.robot.linuxcnc_joints import HalJoints, JointsLost, RshJoints, joint_source

HAL = """
import pathlib
class component:
    def __init__(self, name): pass
    def ready(self): pass
ZERO = 0.5
def get_value(name):
    if name.endswith(".motor-offset"):
        return ZERO
    assert name.endswith(".motor-pos-fb")
    joints = pathlib.Path(__file__).with_name("joints").read_text().split()
    return ZERO + float(joints[int(name[6])])
"""


@contextmanager
def served(*answers):
    """A port at which every connection is answered with the next of these, then closed."""
    listener = socket.create_server(("127.0.0.1", 0))
    asked = []

    def serve():
        for answer in answers:
            accepted, _ = listener.accept()
            with accepted:
                asked.append(accepted.recv(100))
                accepted.sendall(answer)

    thread = Thread(target=serve)
    thread.start()
    with listener:
        yield f"tcp://127.0.0.1:{listener.getsockname()[1]}", asked
        thread.join()


def test_source_is_what_the_address_says():
    assert isinstance(joint_source("hal:"), HalJoints)
    assert isinstance(joint_source("hal:ssh controller"), HalJoints)
    assert isinstance(joint_source("tcp://127.0.0.1:5007"), RshJoints)


@pytest.mark.parametrize(
    "address", ["linuxcnc", "tcp://", "tcp://host", "tcp://host:x", "udp://a:1"]
)
def test_other_address_is_refused(address):
    with pytest.raises(JointsLost, match="joints_from"):
        joint_source(address)


def test_rsh_that_is_not_there_is_lost():
    with pytest.raises(JointsLost, match="cannot be read"):
        RshJoints("tcp://127.0.0.1:1").read()


def test_rsh_is_only_asked_where_the_joints_are():
    line = b"JOINT_POS 10.000000 -20.0 30.0 40.0 0.0 0.0\r\n"
    with served(line) as (url, asked), closing(RshJoints(url)) as source:
        assert source.read() == pytest.approx(list(map(radians, (10, -20, 30, 40))))
    assert asked == [b"get joint_pos\n"]


@pytest.mark.parametrize(
    "answer", [b"", b"JOINT_POS 1 2 3\r\n", b"JOINT_POS 1 2 3 x\r\n", b"\x00\n"]
)
def test_rsh_that_does_not_tell_is_lost_and_then_asked_anew(answer):
    with (
        served(answer, b"JOINT_POS 1.0 2.0 3.0 4.0\r\n") as (url, _),
        closing(RshJoints(url)) as source,
    ):
        with pytest.raises(JointsLost, match="cannot be read"):
            source.read()
        assert source.read()[3] == radians(4.0)


@pytest.fixture
def hal(tmp_path, monkeypatch):
    """A folder that is LinuxCNC's Python module, and the joints in it."""
    (tmp_path / "hal.py").write_text(HAL)
    (tmp_path / "joints").write_text("10.0 -20.0 30.0 40.123456789012345")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    monkeypatch.setattr(linuxcnc_joints, "PYTHON", sys.executable)
    return tmp_path


def test_pins_are_read_again_and_again_by_one_program(hal):
    with closing(joint_source("hal:")) as source:
        assert source.read()[3] == radians(40.123456789012345)
        (hal / "joints").write_text("11.0 0 0 0")
        assert source.read()[0] == radians(11.0)


def test_prefix_hands_the_program_to_a_shell(hal):
    (hal / "like-ssh").write_text('#!/bin/sh\nexec sh -c "$*"\n')
    (hal / "like-ssh").chmod(0o755)
    with closing(joint_source(f"hal:{hal}/like-ssh")) as source:
        assert source.read()[0] == radians(10.0)


def test_program_that_ended_is_started_anew(hal):
    with closing(joint_source("hal:")) as source:
        source.read()
        source._program.kill()
        source._program.wait()
        with pytest.raises(JointsLost):
            source.read()
        assert source.read()[0] == radians(10.0)


def test_joint_that_is_no_number_is_lost(hal):
    (hal / "joints").write_text("nan 0 0 0")
    with closing(joint_source("hal:")) as source, pytest.raises(JointsLost, match="not finite"):
        source.read()


def test_module_that_lies_where_the_program_is_started_is_not_imported(hal, tmp_path, monkeypatch):
    (elsewhere := tmp_path / "campaign").mkdir()
    (elsewhere / "hal.py").write_text("open('ran', 'w')\n" + HAL)
    monkeypatch.chdir(elsewhere)
    with closing(joint_source("hal:")) as source:
        assert source.read()[0] == radians(10.0)
    assert not (elsewhere / "ran").exists()
