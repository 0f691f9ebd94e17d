"""Encoder readings of a real controller: the simulated robot is where its joints say.

From any controller as whoever drives it passes them on (`ToldJoints`). From a real LinuxCNC there
are two ways to them, both only reading:

- `hal:`, or `hal:PREFIX` such as `hal:ssh controller`: LinuxCNC's pins of the encoders, by
  its own Python module in a small program that is kept running beside it. It disturbs nobody. A
  prefix hands the command to a shell, as ssh does; whoever builds a cell of a file has asked its
  user about it.
- `tcp://HOST:PORT`: linuxcncrsh, without a greeting and without taking control. **Not beside
  another client of LinuxCNC 2.9**: its threads share what they take requests apart with, so that a
  client can get the answer to another's question. The rewrite that will be 2.10 serves in turn.
"""

import math
import select
import shlex
import socket
import subprocess
import time
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import suppress
from urllib.parse import urlsplit

import numpy as np
from typing_extensions import override

from drivers.errors import WireError
from drivers.wire.command_prefix import command_prefix
from drivers.wire.linuxcncrsh import Value, answers, encode, read_numbers
from sim.errors import SimError
from sim.geometry import PAR4, Array, Kind
from sim.robot.section import HAL

PYTHON = "/usr/bin/python3"
QUESTION = "joint_pos"
WITHIN_S = 1.0
STARTED_WITHIN_S = 5.0
CHUNK_BYTES = 4096
FORMS = "use hal:, hal:ssh HOST or tcp://HOST:PORT"
CHECK = "check that LinuxCNC runs, and joints_from in the scenario"

PROGRAM = """
import os, sys
sys.path = [folder for folder in sys.path if folder]
import hal
component = hal.component("pkmcal-joints-%d" % os.getpid())
component.ready()
def encoder(joint):
    motor, zero = ("joint.%d.motor-" % joint + each for each in ("pos-fb", "offset"))
    return hal.get_value(motor) - hal.get_value(zero)
for _ in sys.stdin:
    print(*map(encoder, range(JOINTS)), flush=True)
"""
"""Runs beside LinuxCNC: for every line a line, the joints in deg or mm as encoders read them.

It imports nothing from the folder that it happens to be started in.
"""


class JointsLost(SimError):
    """LinuxCNC does not tell its joints: it is not there, or not yet, or does not answer."""


class JointSource(ABC):
    """Source of the joints' real positions."""

    def __init__(self, name: str, kind: Kind) -> None:
        self._name = name
        self._kind = kind

    def read(self) -> Array:
        """(n,): now, rad or mm; raises `JointsLost`, and begins anew the next time."""
        try:
            return self._joints(self._numbers())
        except (OSError, ValueError, WireError) as error:
            self.close()
            problem = f"{self._name}LinuxCNC's joints cannot be read ({error})"
            raise JointsLost(problem, remedy=CHECK) from error

    @abstractmethod
    def close(self) -> None:
        """Let go of it; a second time does nothing."""

    @abstractmethod
    def _numbers(self) -> Sequence[float | str]:
        """Joints that are told, in deg or mm."""

    def _joints(self, numbers: Sequence[float | str]) -> Array:
        arms = self._kind.arms
        if len(numbers) < arms:
            raise ValueError(f"{len(numbers)} joints are told, {arms} are needed")
        told = [float(number) for number in numbers[:arms]]
        if not all(map(math.isfinite, told)):
            raise ValueError("a joint that is not finite")
        return np.array([self._kind.inner(joint) for joint in told])


class ToldJoints(JointSource):
    """Joints that whoever drives the real controller passes on, each time the robot stands."""

    def __init__(self, kind: Kind) -> None:
        super().__init__("", kind)
        self._told: Sequence[float] | None = None

    def tell(self, joints: Sequence[float]) -> None:
        """The robot stands at these, rad or mm; from any thread."""
        self._told = tuple(joints)

    @override
    def close(self) -> None:
        """Forget them."""
        self._told = None

    @override
    def _numbers(self) -> Sequence[float]:
        if self._told is None:
            raise JointsLost("the controller's joints were not told yet", remedy="ask it")
        return [self._kind.outer(joint) for joint in self._told]


def joint_source(joints_from: str, kind: Kind = PAR4) -> JointSource:
    """The source that a scenario names; raises `JointsLost` for what is none."""
    if joints_from.startswith(HAL):
        return HalJoints(command_prefix(joints_from.removeprefix(HAL)), kind)
    return RshJoints(joints_from, kind)


class HalJoints(JointSource):
    """Encoders from their pins, as full doubles: without LinuxCNC's own compensation of joints."""

    def __init__(self, prefix: tuple[str, ...], kind: Kind = PAR4) -> None:
        super().__init__("", kind)
        program = f"JOINTS = {kind.arms}{PROGRAM}"
        self._command = (*prefix, PYTHON, "-u", "-c", shlex.quote(program) if prefix else program)
        self._program: subprocess.Popen[bytes] | None = None

    def close(self) -> None:
        """End the program; the next reading starts another."""
        program, self._program = self._program, None
        if program is None:
            return
        program.kill()
        with suppress(subprocess.TimeoutExpired):
            program.communicate(timeout=WITHIN_S)  # closes its pipes and waits for it

    def _numbers(self) -> Sequence[float | str]:
        within_s = WITHIN_S
        if self._program is None:
            within_s = STARTED_WITHIN_S
            self._program = subprocess.Popen(  # noqa: S603 - the prefix is the user's own command
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                bufsize=0,
            )
        stdin, stdout = self._program.stdin, self._program.stdout
        assert stdin is not None, "it was started with pipes"
        assert stdout is not None, "it was started with pipes"
        stdin.write(b"\n")
        if not select.select([stdout], [], [], within_s)[0]:
            raise TimeoutError(f"no answer within {within_s:g} s")
        return stdout.readline().decode("ascii").split()


class RshJoints(JointSource):
    """Joints asked of linuxcncrsh; connects anew when the connection was lost."""

    def __init__(self, url: str, kind: Kind = PAR4) -> None:
        super().__init__(f"{url}: ", kind)
        self._address = _address(url)
        self._socket: socket.socket | None = None

    def close(self) -> None:
        """Close the connection; the next reading opens another."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _numbers(self) -> Sequence[float | str]:
        deadline_s = time.monotonic() + WITHIN_S
        connected = self._connected()
        connected.sendall(encode(f"get {QUESTION}"))
        while (left_s := deadline_s - time.monotonic()) > 0.0:
            connected.settimeout(left_s)
            data = connected.recv(CHUNK_BYTES)
            if not data:
                raise ConnectionResetError("it closed the connection")
            for message in self._read_answers(data):
                if isinstance(message, Value) and message.word == QUESTION.upper():
                    return read_numbers(message)
        raise TimeoutError(f"no answer within {WITHIN_S:g} s")

    def _connected(self) -> socket.socket:
        if self._socket is None:
            self._read_answers = answers()
            self._socket = socket.create_connection(self._address, timeout=WITHIN_S)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return self._socket


def _address(url: str) -> tuple[str, int]:
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise JointsLost(f"joints_from '{url}': {error}", remedy=FORMS) from error
    if parts.scheme != "tcp" or not host or not port:
        raise JointsLost(f"joints_from '{url}' is no address", remedy=FORMS)
    return host, port
