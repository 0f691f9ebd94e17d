"""Checks of a robot file before it is loaded: its origin, its verdict and the size of its changes.

Objections are collected, so that an operator sees all of them in one line. `--force NAME` overrules
those of one name, and the journal keeps those that were overruled.
"""

from collections.abc import Collection, Iterator, Mapping, Sequence
from pathlib import Path

from pydantic import JsonValue

from campaigns.controllers.issuer import EXPORT, Issuer
from campaigns.controllers.load import differing
from campaigns.controllers.objections import Objection, ObjectionName
from campaigns.errors import ConfigInvalid
from campaigns.evaluation.plausibility import beyond_tolerance
from campaigns.robots.robot import RobotFile, read_robot
from drivers.bounded_files import is_there


def file_objections(robot: RobotFile, issuer: Issuer, nominal: RobotFile) -> Iterator[Objection]:
    """Yield objections to a robot file for a campaign, its issuer, and its nominal robot.

    The nominal set itself may always be loaded, whatever the file states.
    """
    if robot.digest() == nominal.digest():
        return
    yield from issuer.objections(robot)
    yield from _basis_objections(robot.provenance or {}, nominal)
    for text in _beyond_tolerance(robot.parameters, nominal):
        remedy = "look for the mistake in the file or in what was measured"
        yield Objection(ObjectionName.FAR, text, remedy)


def serial_objections(expected: object, connected: str) -> Iterator[Objection]:
    """Yield the objection to a set that was identified with another controller than the connected.

    There is no objection where either has no serial number.
    """
    if expected and connected and expected != connected:
        yield Objection(
            ObjectionName.SERIAL,
            f"it is for the controller of serial number {expected}, connected is {connected}",
            "connect the right controller, or identify this robot",
        )


def held_objections(held: Mapping[str, float], nominal: RobotFile) -> Iterator[Objection]:
    """Yield objections to the parameters in the controller, which the load would back up.

    Values far from nominal may come from a wrong robot or a damaged memory, and a rollback would
    restore them.
    """
    for text in _beyond_tolerance(held, nominal):
        yield Objection(
            ObjectionName.HELD,
            f"what the controller holds is far from nominal: {text}",
            "check the controller: the load would keep this as its old parameters",
        )


def backup_objections(robot: RobotFile, replaced: Mapping[str, float]) -> Iterator[Objection]:
    """Yield the objection to a backup that does not hold what the journal says was replaced.

    `replaced` are the parameters in the journal's record; empty if it has none.
    """
    if replaced and differing(replaced, robot.parameters):
        yield Objection(
            ObjectionName.CHANGED,
            "it does not hold what the journal says the load replaced: another file has its name",
            "bring the file back that the load made, or put the record's values into it",
        )


def _beyond_tolerance(values: Mapping[str, float], nominal: RobotFile) -> Iterator[str]:
    """Yield the values that are beyond the nominal robot's tolerance, in words."""
    # rates of ripples have no tolerance: they are no sizes of parts
    old = nominal.parameters
    sizes = [name for name in old.table.of_robot if name in old and name in values]
    changes = {name: values[name] - old[name] for name in sizes}
    yield from beyond_tolerance(old.table, nominal.tolerance, changes)


def overruled(
    source: Path, objections: Sequence[Objection], force: Collection[ObjectionName]
) -> tuple[Objection, ...]:
    """Return the objections to a file if all are overruled by their names, else raise.

    Raise `ConfigInvalid` with all that are not in one line, and with the names to overrule them.
    """
    standing = [each for each in objections if each.name not in force]
    if standing:
        problems = "; ".join(each.problem for each in standing)
        words = " ".join(f"--force {name}" for name in dict.fromkeys(e.name for e in standing))
        raise ConfigInvalid(
            f"{source}: not loaded: {problems}",
            remedy=f"{standing[0].remedy}; `{words}` loads it all the same",
        )
    return tuple(objections)


def read_parameter_file(path: Path, nominal: RobotFile) -> RobotFile:
    """Return the robot file with parameters for a campaign's robot; raise `ConfigInvalid`."""
    if not is_there(path):
        raise ConfigInvalid(
            f"{path}: there is no such file",
            remedy="`pkmcal export DIR` writes what was identified",
        )
    robot = read_robot(path).robot
    require_same_mechanism(path, robot, nominal)
    return robot


def require_same_mechanism(source: Path, robot: RobotFile, nominal: RobotFile) -> None:
    """Raise `ConfigInvalid` for a robot of another mechanism: no controller could take its set."""
    if robot.mechanism.name != nominal.mechanism.name:
        raise ConfigInvalid(
            f"{source}: it is of a {robot.mechanism.name}, this campaign's robot is a "
            f"{nominal.mechanism.name}",
            remedy=EXPORT,
        )


def _basis_objections(stated: Mapping[str, JsonValue], nominal: RobotFile) -> Iterator[Objection]:
    """Yield objections to nominal robot and verdict, as far as a robot file states its origin."""
    if stated and stated.get("nominal_digest") != nominal.digest():
        yield Objection(
            ObjectionName.NOMINAL,
            f"it rests on another nominal robot ({stated.get('nominal_robot')}, sha256 "
            f"{str(stated.get('nominal_digest'))[:16]}…) than this campaign's ({nominal.name}, "
            f"sha256 {nominal.digest()[:16]}…)",
            EXPORT,
        )
    if stated and stated.get("verdict") != "pass":
        yield Objection(
            ObjectionName.VERDICT,
            f"its identification's verdict is '{stated.get('verdict')}', must be 'pass'",
            "measure more or correct the campaign, then identify and export again",
        )
