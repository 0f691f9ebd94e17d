"""Loading of parameters into a controller: verified in the controller, or the old ones are back."""

# A robot that moves by half-written parameters goes to wrong places. A load is therefore a
# transaction, whose steps workflow/loading.py runs and records:
# 1. Back up what the controller holds, as a robot file (`keep`).
# 2. Write the new set in one command.
# 3. Connect again and read back: a controller may answer from the memory of the old connection what
#    it never stored. What is read back decides, as the answer to a command may be lost that took
#    effect. Only a refusal (`DeviceRefused`) says that the controller kept what it had.
# 4. If a value differs, write the old set back and verify it in the same way.

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from campaigns.errors import LoadNotVerified
from campaigns.robots.robot import RobotDocument, RobotFile, compensated, write_new_robot
from drivers.errors import DeviceRefused, DriverError
from drivers.ports import RobotController

TOLERANCE = 1e-9
"""Tolerance, absolute (mm, deg) or relative, of a value read back against the one written.

A controller that keeps values in other units returns them rounded."""


KEPT = "controller-before-{number}.yaml"


@dataclass(frozen=True, slots=True)
class Change:
    """Value of a parameter in the controller and in the file, mm or deg."""

    name: str
    old: float
    new: float
    std: float | None
    """1 σ of the new value; None if unknown."""

    @property
    def delta(self) -> float:
        """New minus old."""
        return self.new - self.old

    @property
    def in_sigmas(self) -> float | None:
        """Change over its standard deviation; None where the standard deviation is unknown."""
        return self.delta / self.std if self.std else None


def changes(active: Mapping[str, float], robot: RobotFile) -> tuple[Change, ...]:
    """Return the change of every parameter that loading a robot file would make, also of 0.

    `active` holds the controller's values by name. Optional parameters (tilts, skews,
    transmission) are included where they are not 0 before or after.
    """
    new, std, space = robot.for_controller, robot.parameters.std or {}, robot.mechanism.parameters
    beyond = (name for name in space.optional if name in active or name in new)
    changes = tuple(Change(n, active[n], new[n], std.get(n)) for n in space.names)
    return changes + tuple(
        Change(n, active.get(n, 0.0), new.get(n, 0.0), std.get(n)) for n in beyond
    )


def write_verified(
    robot: RobotController, wanted: Mapping[str, float], old: Mapping[str, float]
) -> None:
    """Write a geometry and read it back; put the old one back if the new one does not verify.

    Raise `DeviceRefused` when the controller did not take it, and `LoadNotVerified` when something
    else went wrong; the message says what the controller holds then.
    """
    problem = _write_and_verify(robot, wanted)
    if not problem:
        return
    still_wrong = _restore(robot, old)
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
    """Write the old parameters again and read them back; raise `LoadNotVerified` if they differ."""
    problem = _restore(robot, old)
    if problem:
        raise LoadNotVerified(
            f"the old parameters are not back ({problem})",
            remedy="don't move the robot; `pkmcal load DIR --rollback` tries again",
        )


def differing(held: Mapping[str, float], wanted: Mapping[str, float]) -> list[tuple[str, float]]:
    """Return the parameters that differ from the wanted ones, each with its held value.

    A held parameter that `wanted` does not name must be 0, as sets leave out extensions of 0. A
    wanted parameter that is not held differs, with NaN.
    """
    names = (*wanted, *(name for name in held if name not in wanted))
    # NaN is close to nothing: a parameter that is missing or no number counts as different
    return [
        (name, held.get(name, math.nan))
        for name in names
        if not math.isclose(
            held.get(name, math.nan), wanted.get(name, 0.0), rel_tol=TOLERANCE, abs_tol=TOLERANCE
        )
    ]


def _write_and_verify(robot: RobotController, wanted: Mapping[str, float]) -> str:
    """Write parameters and read them back; return what is wrong, "" if they verified.

    Raise `DeviceRefused`, and `LoadNotVerified` if the parameters cannot be read back.
    """
    interruption = ""
    try:
        robot.write_geometry(wanted)
    except DeviceRefused:
        raise
    except DriverError as error:
        # not yet a failure: the set may be in place although the answer was lost
        interruption = f" ({error.problem})"
    held = _reconnect_and_read(robot, interruption)
    wrong = differing(held, wanted)
    if not wrong:
        return ""
    name, value = wrong[0]
    return (
        f"{len(wrong)} of {len(wanted)} parameters are not as written{interruption}: "
        f"{name} is {value!r}, not {wanted.get(name, 0.0)!r}"
    )


def _restore(robot: RobotController, old: Mapping[str, float]) -> str:
    """Write the old parameters back unless they are held; return what is wrong, "" if they are."""
    try:
        held = robot.read_geometry()
    except DriverError as error:
        held = _reconnect_and_read(robot, f" ({error.problem})")
    try:
        # a controller that already holds the old set is not written again: each write is a risk
        return _write_and_verify(robot, old) if differing(held, old) else ""
    except DriverError as error:
        return error.problem


def _reconnect_and_read(robot: RobotController, interruption: str) -> Mapping[str, float]:
    """Connect again and read; raise `LoadNotVerified` if the parameters cannot be read."""
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
    """Back up the controller's parameters as a robot file with the next free number.

    Return its path. Raise `ConfigInvalid`, `WriteFailed`.
    """
    # one more than the largest number: a gap is not filled, so that numbers follow the loads' order
    numbers = (path.stem.rpartition("-")[2] for path in folder.glob(KEPT.format(number="*")))
    number = 1 + max((int(each) for each in numbers if each.isdecimal()), default=0)
    path = folder / KEPT.format(number=number)
    name = f"{nominal.robot.name}-controller-before-{number}"
    write_new_robot(path, compensated(nominal, name, held))
    return path
