"""A LinuxCNC with the bridge and our driver at it, as the tests with the real one need them."""

import atexit
import shutil
import subprocess
import time
from contextlib import contextmanager
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import pytest
from hal_files import parameters_of
from linuxcnc_instance import EXAMPLES, LinuxcncInstance, why_not

from campaigns.robots.robot import find_robot
from drivers.declaration import RobotSurroundings
from drivers.ports import SystemClock
from drivers.robotline import LineRobot, RobotlineDeadlines
from drivers.transport import CONNECT_S, opener_of
from sim.geometry import PLATE_KINDS
from sim.servers.robotline_server import layout_of

LACKING = why_not()
NEEDS_LINUXCNC = [
    pytest.mark.peer,
    pytest.mark.skipif(bool(LACKING), reason=f"no LinuxCNC to test with: {LACKING}"),
]
NOMINAL = find_robot("par4-prototype").robot
FULL_SPEED_DEG_S = 360.0
PATIENT = RobotlineDeadlines(answer_s=10.0, moving_answer_s=10.0)
"""A busy machine may leave LinuxCNC or the test itself without a core for a second."""
SEEN_WITHIN_S = 10.0
"""Of what the driver tells when it next looks."""
ARRIVES_WITHIN_S = 30.0
COMPILED = "pkmkins.so"


@cache
def compiled_kinematics():
    """Our kinematics module, compiled as `halcompile --install` would, but not installed."""
    if shutil.which("halcompile") is None:
        pytest.skip("halcompile is not installed")
    source = EXAMPLES / "pkmkins" / "pkmkins.c"
    command = ["halcompile", "--compile", str(source)]
    folder = Path(mkdtemp(prefix="pkmkins-"))
    atexit.register(shutil.rmtree, folder)
    subprocess.run(command, cwd=folder, check=True, capture_output=True)
    return folder / COMPILED


def world_controller(folder, variant="cartesian", **settings):
    """A LinuxCNC with our kinematics: of a Par4, or as the example for another robot."""
    modules = [compiled_kinematics()]
    return LinuxcncInstance(folder / "world", variant, modules=modules, **settings)


class Bench:
    """Our driver at one LinuxCNC, whose bridge it asks."""

    def __init__(self, linuxcnc, robot_file=NOMINAL, deadlines=PATIENT):
        self.linuxcnc = linuxcnc
        self.transports = []
        kind = PLATE_KINDS[robot_file.mechanism.name]
        given = RobotSurroundings(
            open_transport=self.open, clock=SystemClock(), layout=layout_of(kind, kind.optional)
        )
        self.robot = LineRobot(given, deadlines)

    def open(self, *, timeout_s=CONNECT_S):
        self.transports.append(opener_of(self.linuxcnc.url)(timeout_s=timeout_s))
        return self.transports[-1]

    def kept(self):
        """The parameters in its HAL file."""
        file = self.linuxcnc.config / "calib.hal"
        return parameters_of(file.read_text(), NOMINAL.mechanism)

    def move(self, joints, speed_fraction=1.0):
        """Move and wait; gives the state at the end."""
        self.robot.move_joints(joints, speed_fraction)
        return self.arrived()

    def arrived(self):
        """Wait for the end of a motion, or its fault."""
        deadline_s = time.monotonic() + ARRIVES_WITHIN_S
        while (state := self.robot.state()).moving and not state.fault:
            assert time.monotonic() < deadline_s, state
            time.sleep(0.005)
        return state

    def started(self, joints, speed_fraction):
        """Start a move and see it on its way."""
        before = self.robot.state().joints
        self.robot.move_joints(joints, speed_fraction)
        while self.robot.state().joints == before:
            time.sleep(0.005)

    def faulty(self):
        """Wait for a fault and its reason, which comes a moment later; gives the state with it."""
        deadline_s = time.monotonic() + SEEN_WITHIN_S
        while not (state := self.robot.state()).fault or "machine is off" in state.fault:
            assert time.monotonic() < deadline_s, state
            time.sleep(0.005)
        return state


@contextmanager
def at(linuxcnc, **settings):
    """Our driver, connected, and LinuxCNC ready; afterwards all connections are closed."""
    linuxcnc.make_ready()
    bench = Bench(linuxcnc, **settings)
    bench.robot.connect()
    try:
        yield bench
    finally:
        bench.robot.close()
        for transport in bench.transports:
            transport.close()
