"""A LinuxCNC and our driver at it, as the tests with the real one need them."""

import atexit
import shutil
import subprocess
import time
from collections.abc import Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cache, partial
from math import radians
from pathlib import Path
from tempfile import mkdtemp

import pytest
from linuxcnc_instance import EXAMPLES, LinuxcncInstance, why_not

from campaigns.controllers.active_kinematics import ActiveKinematics
from campaigns.controllers.linuxcnc_export import (
    CalibrationFile,
    RobotIdentity,
    drawing_flat,
    parameter_pins,
    pin_of,
)
from campaigns.robots.robot import find_robot
from drivers.linuxcnc.hal_parameters import HalParameters, HalPins
from drivers.linuxcnc.robot import LinuxcncRobot
from drivers.linuxcnc.settings import Coordinates, LinuxcncDeadlines, LinuxcncSettings
from drivers.ports import SystemClock
from drivers.transport import CONNECT_S, opener_of

LACKING = why_not()
NEEDS_LINUXCNC = [
    pytest.mark.peer,
    pytest.mark.skipif(bool(LACKING), reason=f"no LinuxCNC to test with: {LACKING}"),
]
NOMINAL = find_robot("par4-prototype").robot
IDENTITY = "par4-prototype"
PIN_OF = parameter_pins(NOMINAL.mechanism)
DRAWING = {pin_of(name): value for name, value in drawing_flat(NOMINAL.mechanism).items()}
FULL_SPEED_RAD_S = radians(360.0)
PATIENT = LinuxcncDeadlines(
    greeting_s=10.0,
    answer_s=10.0,
    order_s=10.0,
    order_margin_s=10.0,
    switch_s=5.0,
    stays_on_s=0.5,
    start_s=10.0,
    frozen_s=10.0,
    stop_s=10.0,
)
"""A busy machine may leave LinuxCNC or the test itself without a core for a second."""
SHORT = replace(PATIENT, order_s=1.0, frozen_s=1.5, stop_s=1.0)
"""For a LinuxCNC that dies: what it will never do again is waited for in full."""
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


def joints_controller(folder, **settings):
    """A LinuxCNC that takes joints only."""
    return LinuxcncInstance(folder / "joints", "joints", **settings)


def world_controller(folder, variant="cartesian", **settings):
    """A LinuxCNC with our kinematics: of a Par4, or as the example for another robot."""
    modules = [compiled_kinematics()]
    return LinuxcncInstance(folder / "world", variant, modules=modules, **settings)


class Bench:
    """Our driver at one LinuxCNC."""

    def __init__(self, linuxcnc, coordinates, *, deadlines=PATIENT, identity=IDENTITY, **told):
        self._use_stored_parameters(linuxcnc, coordinates, identity)
        told |= {"coordinates": coordinates, "deadlines": deadlines}
        self._drive(linuxcnc, NOMINAL, FULL_SPEED_RAD_S, **told)

    def _use_stored_parameters(self, linuxcnc, coordinates, identity):
        file = linuxcnc.config / "calib.hal"
        self.file = CalibrationFile(file, RobotIdentity(identity, NOMINAL), otherwise=None)
        if coordinates is Coordinates.JOINTS:
            self.file = CalibrationFile(file, RobotIdentity(identity, NOMINAL), otherwise=NOMINAL)
            self.store = self.file
        else:
            optional = frozenset(NOMINAL.mechanism.parameters.optional)
            pins = HalPins((*PIN_OF.values(), *DRAWING), (str(linuxcnc.beside),))
            self.store = HalParameters(self.file, pins, PIN_OF, optional, DRAWING)

    def _drive(self, linuxcnc, robot_file, full_speed_per_s, **told):
        self.linuxcnc = linuxcnc
        self.transports = []
        lowest, highest = robot_file.limits.joint
        settings = LinuxcncSettings(
            lowest=lowest,
            highest=highest,
            full_speed_per_s=full_speed_per_s,
            store=self.store,
            poses_of=partial(ActiveKinematics, robot_file.mechanism),
            **told,
        )
        self.robot = LinuxcncRobot(self.open, clock=SystemClock(), settings=settings)

    def open(self, *, timeout_s=CONNECT_S):
        self.transports.append(opener_of(self.linuxcnc.url)(timeout_s=timeout_s))
        return self.transports[-1]

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


@dataclass(frozen=True)
class FixedParameters:
    """Parameters that a kinematics is believed to work with."""

    geometry: Mapping[str, float]

    def read(self):
        return self.geometry


class ForeignBench(Bench):
    """Our driver at a LinuxCNC whose kinematics should be a robot's, whatever its pins say."""

    def __init__(self, linuxcnc, robot, full_speed_per_s):
        joints = robot.mechanism.joints
        self.store = FixedParameters(dict(robot.parameters))
        self._drive(
            linuxcnc,
            robot,
            full_speed_per_s,
            coordinates=Coordinates.WORLD,
            deadlines=PATIENT,
            robot=robot.name,
            joints=len(joints),
            are_rotary=joints[0].is_revolute,
            has_turn=len(robot.mechanism.task) > len("XYZ"),
        )


def at(linuxcnc, coordinates=Coordinates.JOINTS, **settings):
    """Our driver, connected and ready, and afterwards everything as before."""
    return ready(Bench(linuxcnc, coordinates, **settings))


@contextmanager
def ready(bench):
    """A bench connected and ready, and afterwards everything as before."""
    bench.robot.connect()
    try:
        bench.robot.prepare()
        yield bench
    finally:
        bench.robot.close()
        for transport in bench.transports:
            transport.close()
