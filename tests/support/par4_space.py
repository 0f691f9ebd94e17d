"""Par4's parameters by name, as the tests say them."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from campaigns.kinematics.catalog import PAR4
from campaigns.kinematics.feasibility import Limits
from campaigns.kinematics.model import Kinematics
from campaigns.kinematics.parameters import Parameters
from campaigns.robots.robot import RobotFile

SPACE = PAR4.parameters
AXIS_TILT_NAMES = SPACE.select(field="axis_tilt")
SKEW_NAMES = SPACE.select(field="parallelogram_skew")
PLATE = SPACE.names.index("plate_mm")
TILTS = SPACE.places(AXIS_TILT_NAMES)
SKEWS = SPACE.places(SKEW_NAMES)


def places_of(field: str) -> np.ndarray:
    """Places of a field of every arm, (4,)."""
    return SPACE.places(tuple(f"arm{arm}.{field}" for arm in range(SPACE.arms)))


def par4(flat: Mapping[str, float]) -> Kinematics:
    """Robot of values by name, mm and deg."""
    return Kinematics.of(PAR4, flat)


def par4_of(vector: np.ndarray) -> Kinematics:
    """Robot of a vector, mm and rad, or of its first entries."""
    p = np.zeros(len(SPACE.of_robot))
    p[: len(vector)] = vector[: len(p)]
    return Kinematics(PAR4, p)


def turning_limits(joint, theta, swing_rad, **margins) -> Limits:
    """Limits of a robot whose plate may turn so far."""
    return Limits(joint, (None, None, None, theta), swing_rad, **margins)


def with_values(robot: RobotFile, flat: Mapping[str, float]) -> RobotFile:
    """Robot file with some of its values replaced, mm and deg."""
    parameters = Parameters.of(robot.parameters.table, robot.parameters | flat)
    return replace(robot, parameters=parameters)
