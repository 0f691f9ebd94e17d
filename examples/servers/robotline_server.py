"""A controller that speaks robotline, in plain Python, to be copied: docs/reference/robotline.md.

`Controller` is what you replace by calls of your controller; as it stands it is a Par4 whose joints
go straight to their targets. Run it with `python robotline_server.py 5020`, then
`pkmcal new cell --controller tcp://localhost:5020 --tracker …`.
"""

import argparse
import json
import math
import threading
import time
from pathlib import Path

from numbered_lines import Refused, Session, read_number, serve

LIMITS_DEG = -45.0, 90.0
DEG_PER_S = 180.0
"""Speed of the fastest joint at 100 %."""
NOMINAL = {
    f"ARM {arm}": [x, y, 0.0, azimuth, 0.0, 350.0, 700.0]
    for arm, (x, y, azimuth) in enumerate(
        [
            (-172.5, -222.5, 225.0),
            (172.5, -222.5, 315.0),
            (172.5, 222.5, 45.0),
            (-172.5, 222.5, 135.0),
        ]
    )
} | {"PLATE": [100.0]}
"""Lines of GEOM: x, y, z, azimuth, joint offset, arm, forearm of each arm; the plate."""


def forearm_ends(geometry, x, y, z, theta_deg):
    """Return where the plate holds the four forearms, mm; arms 0 and 1 hold its point."""
    (plate,) = geometry["PLATE"]
    theta = math.radians(theta_deg)
    other = (x - plate * math.sin(theta), y + plate * math.cos(theta), z)
    return [(x, y, z), (x, y, z), other, other]


def inverse(geometry, x, y, z, theta_deg):
    """Return the joint angles of a pose, deg; raises `Refused` where there are none."""
    joints = []
    for arm, end in enumerate(forearm_ends(geometry, x, y, z, theta_deg)):
        *motor, azimuth, offset, length, forearm = geometry[f"ARM {arm}"]
        dx, dy, dz = (e - m for e, m in zip(end, motor, strict=True))
        azimuth = math.radians(azimuth)
        out, down = dx * math.cos(azimuth) + dy * math.sin(azimuth), -dz
        constant = (dx * dx + dy * dy + dz * dz + length**2 - forearm**2) / (2.0 * length)
        reach = math.hypot(out, down)
        if reach < abs(constant):
            raise Refused("REACH", f"arm {arm} does not reach {x:g} {y:g} {z:g} mm")
        angle = math.degrees(math.atan2(down, out) - math.acos(constant / reach)) - offset
        joints.append((angle + 180.0) % 360.0 - 180.0)
    return joints


class Controller:
    """Your controller. Joints in deg; whatever cannot be done raises `Refused` with a code."""

    vendor, model, serial, firmware, axes = "Example Robotics", "Par4", "EX-0001", "1.0", 4

    def __init__(self, keep=None, deg_per_s=DEG_PER_S):
        self._keep, self._deg_per_s = keep, deg_per_s
        self.geometry = json.loads(keep.read_text()) if keep and keep.exists() else dict(NOMINAL)
        start = inverse(self.geometry, 0.0, 0.0, -575.0, 0.0)
        self._from, self._to, self._begun_s, self._takes_s = start, start, 0.0, 0.0

    def joints(self):
        """Read the encoders."""
        part = (
            min((time.monotonic() - self._begun_s) / self._takes_s, 1.0) if self._takes_s else 1.0
        )
        return [a + part * (b - a) for a, b in zip(self._from, self._to, strict=True)]

    def is_moving(self):
        """Tell whether the robot moves: True until it stands still in place."""
        return time.monotonic() < self._begun_s + self._takes_s

    def move_joints(self, target, speed_percent):
        """Start a move and return how long it will take, s."""
        if not 0.0 < speed_percent <= 100.0:
            raise Refused("ARGUMENT", f"speed {speed_percent} is not above 0 and up to 100")
        if self.is_moving():
            raise Refused("BUSY", "the robot moves")
        for joint, angle in enumerate(target):
            if not LIMITS_DEG[0] <= angle <= LIMITS_DEG[1]:
                raise Refused("LIMIT", f"joint {joint} to {angle:.3f} deg")
        here = self.joints()
        way = max(abs(b - a) for a, b in zip(here, target, strict=True))
        self._from, self._to = here, list(target)
        self._takes_s = way / (self._deg_per_s * speed_percent / 100.0)
        self._begun_s = time.monotonic()
        return self._takes_s

    def move_pose(self, x, y, z, theta_deg, speed_percent):
        """Start a move by the controller's own kinematics."""
        return self.move_joints(inverse(self.geometry, x, y, z, theta_deg), speed_percent)

    def stop(self):
        """Brake at once."""
        here = self.joints()
        self._from, self._to, self._takes_s = here, here, 0.0

    def replace_geometry(self, staged):
        """Put a whole set to work, kept over a restart, or nothing."""
        if self.is_moving():
            raise Refused("BUSY", "the robot moves")
        if staged.keys() != self.geometry.keys():
            raise Refused("GEOMETRY", f"missing: {min(self.geometry.keys() - staged.keys())}")
        if (
            min(*staged["PLATE"], *(v for n, a in staged.items() if "ARM" in n for v in a[5:]))
            <= 0.0
        ):
            raise Refused("GEOMETRY", "a length that is not positive")
        if self._keep:
            new = self._keep.with_suffix(".new")
            new.write_text(json.dumps(staged))
            new.replace(self._keep)  # whole or not at all
        self.geometry = dict(staged)


class RobotlineSession(Session):
    """One client: what it has staged, and whether it has moved the robot, end with it."""

    VERBS = {
        "HELLO": ("w", "hello"),
        "STATE": ("", "state"),
        "MOVEJ": ("ddddd", "move_joints"),
        "MOVEP": ("ddddd", "move_pose"),
        "STOP": ("", "stop"),
        "GEOM": ("", ""),
        "STAGE": ("", ""),
        "COMMIT": ("", "commit"),
        "ABANDON": ("", "abandon"),
    }

    def __init__(self, controller, lock):
        self._controller, self._lock = controller, lock
        self._staged, self._has_moved = {}, False

    def obey(self, verb, words):
        """GEOM and STAGE have a part's name before their numbers; the rest is in `VERBS`."""
        with self._lock:
            if verb not in {"GEOM", "STAGE"}:
                return super().obey(verb, words)
            size = 2 if words[:1] == ["ARM"] else 1
            name, values = " ".join(words[:size]), words[size:]
            known = self._controller.geometry.get(name)
            if known is None or len(values) != (len(known) if verb == "STAGE" else 0):
                raise Refused("ARGUMENT", f"no such line: {verb} {name}, {len(values)} numbers")
            if verb == "GEOM":
                return [*words, *known]
            self._staged[name] = [read_number(word) for word in values]
            return ()

    def hello(self, version):
        """Greet."""
        if version != 1:
            raise Refused("VERSION", "version 1 is spoken here")
        self._staged = {}
        who = self._controller
        return 1, who.vendor, who.model, who.serial, who.firmware, who.axes

    def state(self):
        """Tell whether it moves, emergency stop, fault, joints."""
        return self._controller.is_moving(), False, "", *self._controller.joints()

    def move_joints(self, *words):
        """Start a joint move."""
        self._has_moved = True
        return (self._controller.move_joints(words[:-1], words[-1]),)

    def move_pose(self, *words):
        """Start a move to a pose."""
        self._has_moved = True
        return (self._controller.move_pose(*words),)

    def stop(self):
        """Stop at once."""
        self._controller.stop()

    def commit(self):
        """Put what is staged to work."""
        self._controller.replace_geometry(self._staged)
        self._staged = {}

    def abandon(self):
        """Throw away what is staged."""
        self._staged = {}

    def lost(self):
        """Stop the motion that nobody watches any more."""
        with self._lock:
            if self._has_moved and self._controller.is_moving():
                self._controller.stop()


if __name__ == "__main__":
    words = argparse.ArgumentParser(description="A robotline controller to copy.")
    words.add_argument("port", type=int, nargs="?", default=5020)
    words.add_argument("--keep", type=Path, help="file that keeps the parameters over a restart")
    words.add_argument("--deg-per-s", type=float, default=DEG_PER_S, help="the fastest joint's")
    words.add_argument("--host", default="127.0.0.1", help="0.0.0.0: on all addresses")
    given = words.parse_args()
    controller, lock = Controller(given.keep, given.deg_per_s), threading.Lock()
    serve(given.host, given.port, lambda: RobotlineSession(controller, lock))
