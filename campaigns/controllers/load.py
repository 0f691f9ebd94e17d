"""Loading of parameters into a controller: they are there, verified, or the old ones are back."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from campaigns.errors import LoadNotVerified
from campaigns.robots.robot import RobotDocument, RobotFile, compensated, write_new_robot
from drivers.errors import DeviceRefused, DriverError
from drivers.ports import RobotController

TOLERANCE = 1e-9
"""Tolerance, absolute or relative, of a value read back against the one written: a controller
may keep it in other units."""


KEPT = "controller-before-{number}.yaml"


@dataclass(frozen=True, slots=True)
class Change:
    """Parameter in the controller and in the file, mm or deg."""

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
    """Return changes that loading a robot file would make, parameter by parameter, all of them.

    What is optional (tilts, skews, transmission) is among them where it is not 0 before or after.
    """
    new, std, space = robot.parameters, robot.parameters.std or {}, robot.mechanism.parameters
    beyond = (name for name in space.optional if name in active or name in new)
    changes = tuple(Change(n, active[n], new[n], std.get(n)) for n in space.names)
    return changes + tuple(
        Change(n, active.get(n, 0.0), new.get(n, 0.0), std.get(n)) for n in beyond
    )


def write_verified(
    robot: RobotController, wanted: Mapping[str, float], old: Mapping[str, float]
) -> None:
    """Write a geometry and read it back; what does not verify is taken back.

    Raises `DeviceRefused` when the controller did not take it, and `LoadNotVerified` when something
    else went wrong, saying what the controller holds then.
    """
    problem = _written(robot, wanted)
    if not problem:
        return
    still_wrong = _restored(robot, old)
    if still_wrong:
        raise LoadNotVerified(
            f"{problem}; the old parameters are not back either ({still_wrong})",
            remedy="don't move the robot; restore the controller's parameters by its own means",
        )
    raise LoadNotVerified(
        f"{problem}; the controller holds the old parameters",
        remedy="check the controller and its connection, then load again",
    )


def put_back(robot: RobotController, old: Mapping[str, float]) -> None:
    """Write the old parameters again and read them back; raises `LoadNotVerified`."""
    problem = _restored(robot, old)
    if problem:
        raise LoadNotVerified(
            f"the old parameters are not back ({problem})",
            remedy="don't move the robot; `pkmcal load DIR --rollback` tries again",
        )


def differing(held: Mapping[str, float], wanted: Mapping[str, float]) -> list[tuple[str, float]]:
    """Return the parameters that are not as wanted, with what is held instead.

    What is held but not named in what is wanted is to be 0: sets leave out extensions that are.
    """
    names = (*wanted, *(name for name in held if name not in wanted))
    return [
        (name, held.get(name, math.nan))
        for name in names
        if not math.isclose(
            held.get(name, math.nan), wanted.get(name, 0.0), rel_tol=TOLERANCE, abs_tol=TOLERANCE
        )
    ]


def _written(robot: RobotController, wanted: Mapping[str, float]) -> str:
    """Write and read back; gives what is wrong then, nothing when it verified.

    The wire is opened again before: what this connection alone knows is not in the controller.
    """
    interruption = ""
    try:
        robot.write_geometry(wanted)
    except DeviceRefused:
        raise
    except DriverError as error:
        interruption = f" ({error.problem})"
    held = _read_anew(robot, interruption)
    wrong = differing(held, wanted)
    if not wrong:
        return ""
    name, value = wrong[0]
    return (
        f"{len(wrong)} of {len(wanted)} parameters are not as written{interruption}: "
        f"{name} is {value!r}, not {wanted.get(name, 0.0)!r}"
    )


def _restored(robot: RobotController, old: Mapping[str, float]) -> str:
    """Write the old parameters back unless they are there; gives what is wrong then."""
    try:
        held = robot.read_geometry()
    except DriverError as error:
        held = _read_anew(robot, f" ({error.problem})")
    try:
        return _written(robot, old) if differing(held, old) else ""
    except DriverError as error:
        return error.problem


def _read_anew(robot: RobotController, interruption: str) -> Mapping[str, float]:
    """Connect again and read; raise `LoadNotVerified` if what is held cannot be read."""
    try:
        robot.reconnect()
        return robot.read_geometry()
    except DriverError as error:
        raise LoadNotVerified(
            f"parameters were written{interruption}, and what the controller holds cannot be read "
            f"({error.problem})",
            remedy="don't move the robot; when the controller answers again, "
            "`pkmcal load DIR` or `pkmcal load DIR --rollback`",
        ) from error


def keep(folder: Path, nominal: RobotDocument, held: Mapping[str, float]) -> Path:
    """Write what the controller holds as a robot file under the next free number; gives it."""
    numbers = (path.stem.rpartition("-")[2] for path in folder.glob(KEPT.format(number="*")))
    number = 1 + max((int(each) for each in numbers if each.isdecimal()), default=0)
    path = folder / KEPT.format(number=number)
    name = f"{nominal.robot.name}-controller-before-{number}"
    write_new_robot(path, compensated(nominal, name, held))
    return path
