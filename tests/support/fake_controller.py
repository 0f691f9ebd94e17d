"""A controller that does nothing, for tests of what talks to it."""

from dataclasses import dataclass, field
from math import radians

from drivers.values import RobotState
from sim.geometry import PAR4, Kind
from sim.robot.controller import Refusal

GEOMETRY = {name: float(number) for number, name in enumerate(PAR4.names)}


@dataclass
class FakeController:
    """Writes down what it is asked to do."""

    kind: Kind = PAR4
    extensions: tuple[str, ...] = ()
    vendor: str = "pkmcal"
    model: str = "Par4 (simulated)"
    serial: str = "7"
    firmware: str = "1.0"
    moving: bool = False
    fault: str = ""
    refusal: Refusal | None = None
    joints: tuple[float, ...] = (0.0, radians(45.0), radians(-90.0), 0.5)
    parameters: dict[str, float] = field(default_factory=lambda: dict(GEOMETRY))
    calls: list[tuple[object, ...]] = field(default_factory=list)

    def state(self, now_s):
        return RobotState((0.0, radians(45.0), radians(-90.0), 0.5), self.moving, self.fault, False)

    def move_joints(self, target_rad, speed_fraction, now_s):
        return self._move("move_joints", tuple(target_rad), speed_fraction, now_s)

    def move_pose(self, x_mm, y_mm, z_mm, theta_rad, speed_fraction, now_s):
        return self._move("move_pose", x_mm, y_mm, z_mm, theta_rad, speed_fraction, now_s)

    def stop(self, now_s):
        self.calls.append(("stop", now_s))
        self.moving = False

    def geometry(self):
        return dict(self.parameters)

    def replace_geometry(self, geometry, now_s):
        self._call("replace_geometry", dict(geometry), now_s)
        self.parameters = dict(geometry)

    def _move(self, *call):
        self._call(*call)
        self.moving = True
        return 1.25

    def _call(self, *call):
        if self.refusal is not None:
            raise self.refusal
        self.calls.append(call)
