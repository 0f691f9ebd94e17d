"""Checks of a robot file before it is loaded: its origin, its verdict and the size of its changes.

Objections are collected, so that an operator sees all of them in one line. `--force` overrules
them, and the journal keeps those that it overruled.
"""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from campaigns.errors import ConfigInvalid
from campaigns.evaluation.plausibility import beyond_tolerance
from campaigns.robots.robot import RobotFile, read_robot
from drivers.bounded_files import is_there

OWN_FILE = "take the file that `pkmcal export DIR` writes"


def file_objections(robot: RobotFile, campaign: str, nominal: RobotFile) -> Iterator[ConfigInvalid]:
    """Yield objections to a robot file for a campaign and its nominal robot.

    The nominal set itself may always be loaded, whatever the file states.
    """
    if robot.digest() == nominal.digest():
        return
    yield from _provenance_objections(robot, campaign, nominal)
    for text in _beyond_tolerance(robot.parameters, nominal):
        yield ConfigInvalid(text, remedy="look for the mistake in the file or in what was measured")


def serial_objections(expected: object, connected: str) -> Iterator[ConfigInvalid]:
    """Yield the objection to a set that was identified with another controller than the connected.

    There is no objection where either has no serial number.
    """
    if expected and connected and expected != connected:
        yield ConfigInvalid(
            f"it is for the controller of serial number {expected}, connected is {connected}",
            remedy="connect the right controller, or identify this robot",
        )


def held_objections(held: Mapping[str, float], nominal: RobotFile) -> Iterator[ConfigInvalid]:
    """Yield objections to the parameters in the controller, which the load would back up.

    Values far from nominal may come from a wrong robot or a damaged memory, and a rollback would
    restore them.
    """
    for text in _beyond_tolerance(held, nominal):
        yield ConfigInvalid(
            f"what the controller holds is far from nominal: {text}",
            remedy="check the controller: the load would keep this as its old parameters",
        )


def _beyond_tolerance(values: Mapping[str, float], nominal: RobotFile) -> Iterator[str]:
    """Yield the values that are beyond the nominal robot's tolerance, in words."""
    # rates of ripples have no tolerance: they are no sizes of parts
    old = nominal.parameters
    sizes = [name for name in old.table.of_robot if name in old and name in values]
    changes = {name: values[name] - old[name] for name in sizes}
    yield from beyond_tolerance(old.table, nominal.tolerance, changes)


def refuse(source: Path, objections: Sequence[ConfigInvalid]) -> None:
    """Raise `ConfigInvalid` with all objections in one line, if there are any."""
    if objections:
        problems = "; ".join(each.problem for each in objections)
        raise ConfigInvalid(
            f"{source}: not loaded: {problems}",
            remedy=f"{objections[0].remedy}; --force loads it all the same",
        )


def read_parameter_file(path: Path, folder: Path, nominal: RobotFile) -> RobotFile:
    """Return the robot file with parameters for a campaign's robot; raise `ConfigInvalid`."""
    if not is_there(path):
        raise ConfigInvalid(
            f"{path}: there is no such file",
            remedy=f"`pkmcal export {folder}` writes what was identified",
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
            remedy=OWN_FILE,
        )


def _provenance_objections(
    robot: RobotFile, campaign: str, nominal: RobotFile
) -> Iterator[ConfigInvalid]:
    """Yield objections to the origin that a robot file states."""
    stated = robot.provenance
    if not stated:
        yield ConfigInvalid("it does not say where its parameters come from", remedy=OWN_FILE)
        return
    if stated.get("campaign") != campaign:
        yield ConfigInvalid(
            f"it is of the campaign '{stated.get('campaign')}', this one is '{campaign}'",
            remedy=OWN_FILE,
        )
    if stated.get("nominal_digest") != nominal.digest():
        yield ConfigInvalid(
            f"it rests on another nominal robot ({stated.get('nominal_robot')}, sha256 "
            f"{str(stated.get('nominal_digest'))[:16]}…) than this campaign's ({nominal.name}, "
            f"sha256 {nominal.digest()[:16]}…)",
            remedy=OWN_FILE,
        )
    if stated.get("verdict") != "pass":
        yield ConfigInvalid(
            f"its identification's verdict is '{stated.get('verdict')}', must be 'pass'",
            remedy="measure more or correct the campaign, then identify and export again",
        )
