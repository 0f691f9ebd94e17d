"""Puts a parameter set into a controller so that it is either there, verified, or as it was before."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from campaigns.errors import LoadNotVerified
from campaigns.parameters import PARAMETER_NAMES
from campaigns.robot import RobotFile
from drivers.errors import DriverError
from drivers.ports import RobotController

RELATIVE_TOLERANCE = 1e-9
"""How far a value read back may be from the one written: a controller may keep it in radians."""


@dataclass(frozen=True, slots=True)
class Change:
    """One parameter in the controller and in the file, mm or deg."""

    name: str
    old: float
    new: float
    std: float | None

    @property
    def delta(self) -> float:
        """New minus old."""
        return self.new - self.old

    @property
    def in_sigmas(self) -> float | None:
        """The change over its standard deviation; None where that is not known."""
        return self.delta / self.std if self.std else None


def changes(active: Mapping[str, float], robot: RobotFile) -> tuple[Change, ...]:
    """What loading a robot file would change, parameter by parameter, all 29."""
    new, std = robot.geometry_flat(), robot.uncertainty or {}
    return tuple(Change(n, active[n], new[n], std.get(n)) for n in PARAMETER_NAMES)


def write_verified(
    robot: RobotController, wanted: Mapping[str, float], old: Mapping[str, float]
) -> None:
    """Write a geometry and read it back; what does not verify is taken back.

    Raises `LoadNotVerified`, saying what the controller holds then, or a driver's error.
    """
    robot.write_geometry(wanted)
    wrong = differing(robot.read_geometry(), wanted)
    if not wrong:
        return
    name, held = wrong[0]
    problem = f"the controller holds {name} = {held!r} after {wanted[name]!r} was written"
    try:
        robot.write_geometry(old)
        restored = not differing(robot.read_geometry(), old)
    except DriverError as error:
        raise LoadNotVerified(
            f"{problem}; the old parameters could not be written back ({error.problem})",
            remedy="don't move the robot; `pkmcal load --rollback` when the controller answers again",
        ) from error
    if restored:
        raise LoadNotVerified(
            f"{problem}; the old parameters are back",
            remedy="check the controller's geometry store",
        )
    raise LoadNotVerified(
        f"{problem}; the old parameters did not verify either",
        remedy="don't move the robot; restore the controller's parameters by its own means",
    )


def differing(held: Mapping[str, float], wanted: Mapping[str, float]) -> list[tuple[str, float]]:
    """The parameters that are not as wanted, with what is held instead."""
    return [
        (name, held.get(name, math.nan))
        for name in PARAMETER_NAMES
        if not math.isclose(
            held.get(name, math.nan),
            wanted[name],
            rel_tol=RELATIVE_TOLERANCE,
            abs_tol=RELATIVE_TOLERANCE,
        )
    ]
