"""Choice of a check's shots: those by which the part that changed is least often taken for another.

Had part i alone changed by s, part j explains all but d = s² |(1 - P_j) a_i|² of χ², with a_i its
column and P_j the projection on those of j, both whitened and beside a free frame. Schwarz's
criterion then prefers i by d, less the price of i's unknowns beyond j's, with σ = 2 √d. It is named
alone if that is more than `AS_LIKELY`.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import scipy

from campaigns.arrays import Array, Index
from campaigns.estimation import information
from campaigns.estimation.change_detection import Cause
from campaigns.estimation.residuals import FRAME_COLUMNS
from campaigns.evaluation.calibration_check import AS_LIKELY, SAME
from campaigns.identification import checking
from campaigns.mechanisms.parameters import FOREARM, ParameterSpace

STAND_MM = 0.3
"""Motion of the tracker's stand that shall be told from a part's change."""
HARDLY_TOLD = 0.1
"""Weight of forearms, which eight shots hardly tell from the mounts that they hang on, nor those of
rails from their encoders."""
CHUNK = 100
"""Choices judged at a time."""
SINGULAR = 1e-9
"""Share of a cause's information that is added to it: few shots may not tell it from the frame."""


def confusions(
    stored: checking.StoredCalibration, joints: Array, poses: Array, noise_mm2: Array
) -> Callable[[Index], Array]:
    """Expected number of confusions of two parts by choices (B, N) of shots, (B,).

    Of candidates: joints (M, n), poses (M, t), covariances of points (M, 3, 3).
    """
    robot, space, count = stored.kinematics, stored.space, len(poses)
    by_all = robot.jacobian(joints, poses)[:, :3]
    in_robot = [
        *checking.causes_in_robot(
            robot, by_all[:, :, space.offsets], lambda names: by_all[:, :, space.places(names)]
        )
    ]
    told = information.point_jacobian(robot, stored.known.names, joints, poses)
    frame = told[:, :, -FRAME_COLUMNS:]
    known = told[:, :, :-FRAME_COLUMNS].reshape(3 * count, -1)
    expected = known @ stored.covariance @ known.T
    blocks = expected.reshape(count, 3, count, 3)
    blocks[np.arange(count), :, np.arange(count)] += noise_mm2

    def of_some(chosen: Index) -> Array:
        own = frame[chosen]
        every = [replace(each, columns=each.columns[chosen]) for each in in_robot]
        every += checking.causes_in_setup(own)
        columns = np.concatenate([*(each.columns for each in every), own], axis=3)
        rows = (3 * chosen[:, :, None] + np.arange(3)).reshape(len(chosen), -1)
        columns = columns.reshape(*rows.shape, -1)
        weighed = np.linalg.solve(expected[rows[:, :, None], rows[:, None, :]], columns)
        return _confused(every, columns.swapaxes(1, 2) @ weighed, rows.shape[1], space)

    def of_all(choices: Index) -> Array:
        parts = np.array_split(choices, -(-len(choices) // CHUNK))
        return np.concatenate([of_some(each) for each in parts])

    return of_all


def _confused(
    every: list[Cause], information_of_all: Array, coordinates: int, space: ParameterSpace
) -> Array:
    """The same by the information (B, K + 6, K + 6) of all columns, the frame's last."""
    own, frame = information_of_all[:, :, :-FRAME_COLUMNS], slice(-FRAME_COLUMNS, None)
    by_frame = np.linalg.solve(information_of_all[:, frame, frame], own[:, frame])
    told = own[:, :-FRAME_COLUMNS] - own[:, frame].swapaxes(1, 2) @ by_frame
    widths = [each.columns.shape[-1] for each in every]
    starts = np.cumsum([0, *widths])
    changed = [(place, each) for place, each in enumerate(every) if _size(each, space)]
    at = np.array([k for place, _ in changed for k in range(starts[place], starts[place + 1])])
    of = [each for place, each in changed for _ in range(widths[place])]
    unknowns = np.array([each.columns.shape[-1] for each in of])
    size2 = np.array([_size(each, space) ** 2 for each in of])
    forearms = space.of_field(FOREARM)
    weights = np.array([HARDLY_TOLD if each.name in forearms else 1.0 for each in of])
    gained, found = told[:, at, at], np.zeros(len(told))
    price = np.log(coordinates) - 1.0
    for place, other in enumerate(every):
        columns = slice(starts[place], starts[place + 1])
        seen, square = told[:, columns, at], told[:, columns, columns]
        spare = SINGULAR * np.trace(square, axis1=1, axis2=2)[:, None, None]
        explained = np.linalg.solve(square + spare * np.eye(widths[place]), seen)
        left = size2 * np.maximum(gained - np.einsum("bkt,bkt->bt", seen, explained), 0.0)
        beyond = left - AS_LIKELY - (unknowns - widths[place]) * price
        chance = scipy.special.ndtr(-beyond / np.maximum(2.0 * np.sqrt(left), SINGULAR))
        others = [each.kind != other.kind or _part(each) != _part(other) for each in of]
        # a wider cause that does just the same, as a rail's mount its encoder's, is not named
        told_apart = (unknowns >= widths[place]) | (left > SAME * size2 * gained)
        found += (chance * told_apart) @ (weights * others)
    return found


def _size(cause: Cause, space: ParameterSpace) -> float:
    """Change along each column that shall be named, mm or rad; 0 of what need not be."""
    if cause.kind == "frame":
        return STAND_MM / np.sqrt(3.0) if cause.columns.shape[-1] < FRAME_COLUMNS else 0.0
    if cause.kind == "joint":
        return checking.EXPECTED_OFFSET[space[cause.name].unit]
    return checking.EXPECTED_LENGTH_MM if cause.kind == "length" else 0.0


def _part(cause: Cause) -> str:
    """What is named: a stand that moved is one part, whenever it did."""
    return "" if cause.kind == "frame" else cause.name
