"""A controller that holds parameters, and does with the next write what a test says."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, field

from paper_campaign import NOMINAL

from drivers.errors import DeviceRefused
from drivers.values import Identity

OLD = dict(NOMINAL.robot.parameters)


class PowerCut(BaseException):
    """The process ends here."""


@dataclass
class Controller:
    """Holds all parameters; the next write does what `next_write` says."""

    held: dict[str, float] = field(default_factory=lambda: dict(OLD))
    serial: str = "R-1"
    next_write: str = "take"
    writes: int = 0

    def identity(self) -> Identity:
        return Identity("Acme", "Par4", self.serial, "1.0", "robotline 1")

    def read_geometry(self) -> dict[str, float]:
        return dict(self.held)

    def lacks(self, names: Collection[str]) -> tuple[str, ...]:
        return ()

    def write_geometry(self, geometry: Mapping[str, float]) -> None:
        self.writes += 1
        act, self.next_write = self.next_write, "take"
        if act == "refuse":
            raise DeviceRefused("the robot moves", remedy="wait", code="BUSY")
        if act == "take half, die":
            self.held |= {name: geometry[name] for name in list(geometry)[:20]}
        elif act.startswith("take"):
            self.held = dict(geometry)
        if act.endswith("die"):
            raise PowerCut

    def reconnect(self) -> None:
        pass
