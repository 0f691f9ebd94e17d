"""An instrument that speaks pointline, in plain Python, to be copied: docs/reference/pointline.md.

`Instrument` is what you replace by calls of your instrument's library. As it stands it looks at the
robot of robotline_server.py, which it takes for a little different from what its controller
believes: `python pointline_server.py 5021 --robot 127.0.0.1:5020`.
"""

import argparse
import math
import random
import socket
import threading
import time

from numbered_lines import Refused, Session, checksum, serve
from robotline_server import NOMINAL, forearm_ends

STATION_MM = 2500.0, 0.0, -500.0
"""Where it stands in the robot's base frame; its axes are turned by half a turn about z."""
NOISE_MM = 0.02
SEED = 7
STARTS = [(0, 0, z, 0) for z in (-575, -800, -400)] + [
    (x, y, -575, 0) for x in (200, -200) for y in (200, -200)
]
"""From one of these poses the plate is found wherever it is."""
LARGEST_THETA_DEG = 60.0


class Instrument:
    """Your instrument. Points in mm in its own frame; what cannot be done raises `Refused`."""

    vendor, model, serial, firmware = "Example Metrology", "T-1", "4711", "1.0"
    reflectors = {"CCR-1.5in": 19.05}
    """Names, and from the centre to the surface, mm."""

    def __init__(self, robot=None):
        self._robot = robot
        self._draw = random.Random(SEED)
        self._seconds, self._count = 1.0, 0
        self.reflector = "CCR-1.5in"
        self._true = {name: [*line] for name, line in NOMINAL.items()}
        for name in ("ARM 1", "ARM 2", "ARM 3"):  # as it was really made; arm 0 carries the frame
            for column, size in enumerate((1.0, 1.0, 1.0, 0.0, 0.2, 0.5, 0.5)):
                self._true[name][column] += size * self._draw.gauss(0.0, 1.0)

    def sees_reflector(self):
        """Tell whether a reflector is in view."""
        return self._robot is not None

    def air(self):
        """Temperature °C, pressure hPa, humidity %; raise `Refused("NONE")` if it knows none."""
        return 20.0, 1013.25, 50.0

    def prepare(self, reflector, seconds):
        """Select a reflector and a measuring time."""
        if reflector not in self.reflectors:
            raise Refused("REFLECTOR", f"there is no reflector {reflector}")
        self.reflector, self._seconds = reflector, seconds

    def measure(self):
        """Return the number of this measurement, the point and its covariance."""
        joints = self._joints()
        time.sleep(self._seconds)
        if self._joints() != joints:
            raise Refused("FAULT", "the robot moved while it was measured")
        self._count += 1
        point = [value + self._draw.gauss(0.0, NOISE_MM) for value in self._seen(joints)]
        return self._count, point, [NOISE_MM**2, 0.0, 0.0, NOISE_MM**2, 0.0, NOISE_MM**2]

    def turn_to(self, point):
        """Point there. This one sees the robot wherever it is, and nothing else."""
        if not self.sees_reflector():
            raise Refused("BEAM", "no reflector was found")

    def direction(self):
        """Where the beam points."""
        try:
            return self._seen(self._joints())
        except Refused:
            raise Refused("NONE", "it looks at nothing") from None

    def _joints(self):
        """Ask the robot's controller where its joints are, in its own protocol."""
        if not self.sees_reflector():
            raise Refused("NOBEAM", "no reflector is in view")
        try:
            with socket.create_connection(self._robot, timeout=2.0) as wire:
                wire.sendall(b">1 STATE *%s\n" % checksum(b">1 STATE"))
                with wire.makefile("rb") as told:
                    _, _, _, _, _, _, *joints, _ = told.readline().decode().split()
            return [float(joint) for joint in joints]
        except (OSError, ValueError):
            raise Refused("FAULT", "the robot's controller does not tell its joints") from None

    def _seen(self, joints):
        """Where the reflector is, in this instrument's frame."""
        x, y, z, _ = forward(self._true, joints)
        return [STATION_MM[0] - x, STATION_MM[1] - y, z - STATION_MM[2]]


def forward(geometry, joints):
    """Return the pose x, y, z, theta (mm, deg) at joint angles, the plate hanging below."""
    for start in STARTS:
        pose = newton(geometry, joints, start)
        if pose is not None and pose[2] < 0.0 and abs(pose[3]) < LARGEST_THETA_DEG:
            return pose
    raise Refused("FAULT", "the imagined robot cannot stand there")


def newton(geometry, joints, start):
    """Return a pose at which no forearm is too long, from a start; None: it finds none."""

    def too_long(pose):
        ends = forearm_ends(geometry, *pose)
        return [_too_long(geometry[f"ARM {n}"], joints[n], ends[n]) for n in range(4)]

    pose = list(start)
    for _ in range(50):
        wrong = too_long(pose)
        if max(map(abs, wrong)) < 1e-10:
            return pose
        columns = []
        for axis in range(4):
            step = [value + 1e-6 * (axis == place) for place, value in enumerate(pose)]
            columns.append([(b - a) / 1e-6 for a, b in zip(wrong, too_long(step), strict=True)])
        try:
            change = solved([list(row) for row in zip(*columns, wrong, strict=True)])
        except ZeroDivisionError:
            return None
        pose = [value - part for value, part in zip(pose, change, strict=True)]
    return None


def _too_long(arm, joint_deg, end):
    """By how much a forearm is longer than it is, mm."""
    x, y, z, azimuth, offset, length, forearm = arm
    angle, azimuth = math.radians(joint_deg + offset), math.radians(azimuth)
    out = length * math.cos(angle)
    elbow = x + out * math.cos(azimuth), y + out * math.sin(azimuth), z - length * math.sin(angle)
    return math.dist(elbow, end) - forearm


def solved(rows):
    """Solve linear equations [A | b] by elimination with pivots."""
    size = len(rows)
    for column in range(size):
        best = max(range(column, size), key=lambda row: abs(rows[row][column]))
        rows[column], rows[best] = rows[best], rows[column]
        for row in range(size):
            if row != column:
                factor = rows[row][column] / rows[column][column]
                pairs = zip(rows[row], rows[column], strict=True)
                rows[row] = [a - factor * b for a, b in pairs]
    return [rows[row][size] / rows[row][row] for row in range(size)]


class PointlineSession(Session):
    """One client."""

    LONGEST = 511
    VERBS = {
        "HELLO": ("w", "hello"),
        "STATE": ("", "state"),
        "AIR": ("", "air"),
        "REFLECTOR": ("w", "definition"),
        "PREPARE": ("nd", "prepare"),
        "MEASURE": ("", "measure"),
        "DIRECTION": ("", "direction"),
        "GOTO": ("ddd", "go_to"),
        "FIND": ("d", "find"),
    }

    def __init__(self, instrument, lock):
        self._instrument, self._lock = instrument, lock

    def obey(self, verb, words):
        """One question at a time, whoever asks it."""
        with self._lock:
            return super().obey(verb, words)

    def hello(self, version):
        """Greet."""
        if version != 1:
            raise Refused("VERSION", "version 1 is spoken here")
        who = self._instrument
        return 1, who.vendor, who.model, who.serial, who.firmware

    def state(self):
        """Tell busy, initialised, warm, locked, reflector."""
        return False, True, True, self._instrument.sees_reflector(), self._instrument.reflector

    def air(self):
        """Tell temperature, pressure, humidity."""
        return self._instrument.air()

    def definition(self, index):
        """Tell how many reflectors there are, and the name and offset of one."""
        known = list(self._instrument.reflectors.items())
        if index >= len(known):
            raise Refused("ARGUMENT", f"reflector {index} of {len(known)}")
        return len(known), *known[index]

    def prepare(self, reflector, seconds):
        """Select a reflector and a measuring time."""
        self._instrument.prepare(reflector, seconds)

    def measure(self):
        """Measure the reflector where it is now."""
        count, point, covariance = self._instrument.measure()
        return count, self._instrument.reflector, *point, *covariance

    def direction(self):
        """Tell where the beam points."""
        return self._instrument.direction()

    def go_to(self, *point):
        """Point there."""
        self._instrument.turn_to(point)

    def find(self, _distance):
        """Search where it points."""
        self._instrument.turn_to(None)


if __name__ == "__main__":
    words = argparse.ArgumentParser(description="A pointline instrument to copy.")
    words.add_argument("port", type=int, nargs="?", default=5021)
    words.add_argument("--robot", help="HOST:PORT of the robotline controller that it looks at")
    words.add_argument("--host", default="127.0.0.1", help="0.0.0.0: on all addresses")
    given = words.parse_args()
    host, _, port = (given.robot or "").rpartition(":")
    instrument = Instrument((host, int(port)) if given.robot else None)
    lock = threading.Lock()
    serve(given.host, given.port, lambda: PointlineSession(instrument, lock))
