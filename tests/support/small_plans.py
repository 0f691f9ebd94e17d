"""Plans of a few shots, and the work that they make for the engine."""

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from fake_cell import CENTRE, NOMINAL, ROBOT, FakeCell
from tested_journal import journal_in

from campaigns.errors import Interrupted
from campaigns.identification.options import IdentificationOptions
from campaigns.measuring.work import Rules, Work
from campaigns.planning.paths import RobotModel
from campaigns.planning.plan_check import Pace
from campaigns.planning.plan_file import PlannedShot, plan_digest
from campaigns.planning.plans import View
from campaigns.planning.steps import Step, joint_steps
from campaigns.settings.sections import GateConfig, SettleConfig
from campaigns.shots.shot_sets import ShotSet
from drivers.values import Pose

LIMITS = ROBOT.limits
OPTIONS = IdentificationOptions()
VIEW = View((2500.0, 0.0, -500.0), (2500.0, 0.0, 75.0), float(np.radians(25.0)))
PACE = Pace(1.0, 0.2, 1.0)
OPEN = RobotModel(NOMINAL, LIMITS, CENTRE)
"""Robot in an unrestricted space."""
SPEED_FRACTION = 0.3
SETTLE = SettleConfig()
GATE = GateConfig()


def joints_at(*pose: float) -> np.ndarray:
    """Joints (4,) of a pose, mm and rad."""
    return NOMINAL.inverse(np.array([pose], dtype=float)).values_or_raise()[0]


def of(shots: Sequence[PlannedShot], purpose: ShotSet) -> list[PlannedShot]:
    """Shots of a set."""
    return [shot for shot in shots if shot.purpose is purpose]


def planned(
    shot: int, purpose: ShotSet, pair: int | None, x: float, y: float, z: float, theta: float = 0.0
) -> PlannedShot:
    joints = tuple(joints_at(x, y, z, theta).tolist())
    return PlannedShot(shot, purpose, pair, Pose(x, y, z, theta), joints)


def drift(shot: int) -> PlannedShot:
    return planned(shot, ShotSet.DRIFT, None, *CENTRE[:3].tolist())


def pair(
    first_shot: int, number: int, here: Sequence[float], there: Sequence[float]
) -> tuple[PlannedShot, PlannedShot]:
    identification = ShotSet.IDENTIFICATION
    return (
        planned(first_shot, identification, number, *here),
        planned(first_shot + 1, identification, number, *there),
    )


TWO_PAIRS = (
    drift(0),
    *pair(1, 0, (150.0, 60.0, -600.0), (-120.0, 80.0, -520.0, 0.2)),
    *pair(3, 1, (-80.0, -160.0, -650.0), (60.0, -120.0, -500.0, -0.3)),
    drift(5),
)
FOUR_PAIRS = (
    *TWO_PAIRS[:-1],
    *pair(5, 2, (200.0, -40.0, -480.0), (20.0, 180.0, -700.0, 0.1)),
    *pair(7, 3, (-180.0, 20.0, -640.0), (90.0, 130.0, -560.0, -0.2)),
    drift(9),
)


def work(shots: Sequence[PlannedShot] = TWO_PAIRS, **changes: object) -> Work:
    settings: dict[str, object] = {
        "stage": "run",
        "steps": joint_steps(shots),
        "plan_digest": plan_digest(shots, ROBOT.mechanism),
        "robot_file_digest": ROBOT.digest(),
        "configuration": {"name": "test"},
        "robot": OPEN,
    }
    rules = {
        "speed_fraction": SPEED_FRACTION,
        "settle": SETTLE,
        "gate": GATE,
        "search_mm": 2500.0,
        "options": OPTIONS,
    }
    of_rules = {field.name for field in fields(Rules)}
    rules |= {name: changes.pop(name) for name in of_rules & {*changes}}
    return Work(**(settings | {"rules": Rules(**rules)} | changes))


def commanded_as_pose(shot: PlannedShot, approach: tuple[tuple[float, ...], ...] = ()) -> Step:
    return Step(shot, "pose", approach)


def interrupted(
    folder: Path, move: int, shots: Sequence[PlannedShot] = TWO_PAIRS, **changes
) -> None:
    """A first session, stopped by Ctrl-C during that move."""
    cell = FakeCell()
    cell.robot.during_move = {move: cell.wish.ask}
    with journal_in(folder, cell.calls) as journal, pytest.raises(Interrupted):
        cell.measure(journal, work(shots, **changes))
