"""Platforms of parallel robots: where the forearms' lower ends are, seen from the controlled point.

They depend on the platform's turn alone: B_i = X + b_i(θ).
"""

import copy
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Self

import numpy as np
from typing_extensions import override

from campaigns.arrays import Array
from campaigns.mechanisms.mechanism import Axis
from campaigns.mechanisms.parameters import ParameterField

POSITION = (Axis("x", "prismatic"), Axis("y", "prismatic"), Axis("z", "prismatic"))
TURN = Axis("theta", "revolute")
OF_TWO_PARTS = 4
"""Arms of a platform of two parts; 0 and 1 hold the first part, 2 and 3 the second."""
SLIDE_STEP_MM = 120.0


@dataclass(frozen=True, slots=True)
class TurnScale:
    """Sizes of a platform's turn beside those of its position, of one robot or of each row."""

    lever_mm: Array
    """Length that turns an angle into a way."""
    step_rad: Array | float
    """Longest step by which the turn is sought."""
    limit_rad: float
    """The wanted assembly turns less than that."""


HINGE_LEVER = 1.0 / 7.0
"""Lever of a hinged plate's turn over the length of the forearms: robots of one shape are alike."""
HINGE_STEP_RAD, HINGE_LIMIT_RAD = 0.35, 0.5 * math.pi


class Platform(ABC):
    """Kind of platform: task axes, fields in files, and the forearms' lower ends.

    Values are (f,) or (f, 1).
    """

    arms: int
    """Number of forearms that hold it."""
    task: tuple[Axis, ...]
    """Task axes: x, y, z of the controlled point first."""
    fields: tuple[ParameterField, ...] = ()
    """Parameters, in the order of its values."""
    at_point: tuple[int, ...] = ()
    """Arms that end in the controlled point however a platform that turns is turned."""
    points_along_x = False
    """Whether the base frame's x axis is a direction of the platform."""

    def turn_scale(self, values: Array, forearms_mm: Array) -> TurnScale:  # noqa: ARG002
        """Sizes of the turn; beyond 90° a hinged plate has turned over."""
        return TurnScale(HINGE_LEVER * forearms_mm.mean(axis=0), HINGE_STEP_RAD, HINGE_LIMIT_RAD)

    def seen_from(self, half: int) -> Self:  # noqa: ARG002 - two parts have two
        """Platform whose measured point is on one of its parts, 1 or 2; raises `ValueError`."""
        raise ValueError("a platform of one part has no halves")

    def joints_mm(self, values: Array, poses: Array) -> Array:
        """B_i in the base frame, (N, n, 3), at poses (N, t)."""
        return np.asarray(poses[:, None, :3] + self.offsets_mm(values, poses).T)

    @abstractmethod
    def offsets_mm(self, values: Array, poses: Array) -> Array:
        """B_i - X, (3, n, N), at poses (N, t)."""

    @abstractmethod
    def joints_by_turn(self, values: Array, poses: Array) -> Array:
        """∂B_i by the turn, (3, n, N), at poses (N, t)."""

    @abstractmethod
    def joints_by_fields(self, values: Array, poses: Array) -> Array:
        """∂B_i by each field, (f, 3, n, N)."""


class TranslatingPlatform(Platform):
    """Delta's platform, which keeps its direction: all forearms end in one contracted point."""

    arms = 3
    task = POSITION

    @override
    def offsets_mm(self, values: Array, poses: Array) -> Array:
        """Nothing for every arm."""
        return np.zeros((3, self.arms, len(poses)))

    @override
    def joints_by_turn(self, values: Array, poses: Array) -> Array:
        """Never asked: there is no turn."""
        raise NotImplementedError

    @override
    def joints_by_fields(self, values: Array, poses: Array) -> Array:
        """Derivatives by no fields: there are none."""
        return np.empty((0, 3, self.arms, len(poses)))


class TwoPartPlatform(Platform):
    """Platform of two parts that stand apart by its one value and a direction of the turn.

    Arms 0 and 1 end `shares[0]` of the way between the parts from the controlled point, arms 2 and
    3 `shares[1]` of it.
    """

    arms = OF_TWO_PARTS
    task = (*POSITION, TURN)

    def __init__(self, shares: tuple[float, float]) -> None:
        self._shares = np.repeat(shares, OF_TWO_PARTS // 2)
        self.at_point = tuple(np.flatnonzero(self._shares == 0.0).tolist())

    @override
    def seen_from(self, half: int) -> Self:
        """The same two parts: what holds of differences of shares holds of each."""
        seen = copy.copy(self)
        first, second = self._shares[[0, -1]] - self._shares[0 if half == 1 else -1]
        TwoPartPlatform.__init__(seen, (float(first), float(second)))
        return seen

    @abstractmethod
    def apart(self, turn: Array) -> Array:
        """From part 1 to part 2 in the base frame at turns (N,), for a value of 1, (2, N)."""

    @abstractmethod
    def apart_by_turn(self, turn: Array) -> Array:
        """∂(apart)/∂θ, (2, N)."""

    @override
    def offsets_mm(self, values: Array, poses: Array) -> Array:
        """B'_i - X, (3, 4, N)."""
        return self._shared(values[0] * self.apart(poses[:, 3]))

    @override
    def joints_by_turn(self, values: Array, poses: Array) -> Array:
        """∂B_i/∂θ, (3, 4, N): nothing for arms that end in the controlled point."""
        return self._shared(values[0] * self.apart_by_turn(poses[:, 3]))

    @override
    def joints_by_fields(self, values: Array, poses: Array) -> Array:
        """∂B_i by the way between the parts, (1, 3, 4, N)."""
        return self._shared(self.apart(poses[:, 3]))[None]

    def _shared(self, apart: Array) -> Array:
        """Motions of the joints (3, 4, N) by one of part 2 away from part 1, (2, N)."""
        moved = np.zeros((3, self.arms, apart.shape[1]))
        np.multiply(self._shares[:, None], apart[:, None], out=moved[:2])
        return moved


class HingedPlate(TwoPartPlatform):
    """Articulated plate of Par4 and H4 (paper eq. 9): part 2 lies along (-sin θ, cos θ, 0)."""

    fields = (
        ParameterField("plate_mm", "the distance between the halves of the plate, mm", "length"),
    )

    @override
    def apart(self, turn: Array) -> Array:
        """(-sin θ, cos θ)."""
        return np.array([-np.sin(turn), np.cos(turn)])

    @override
    def apart_by_turn(self, turn: Array) -> Array:
        """(-cos θ, -sin θ)."""
        return np.array([-np.cos(turn), -np.sin(turn)])


class SlidingBars(TwoPartPlatform):
    """I4's two bars that slide along x, where a rack turns the tool: part 2 is rθ behind part 1."""

    fields = (ParameterField("pinion_mm", "travel of the bars for a turn of 1 rad, mm", "length"),)
    points_along_x = True

    @override
    def turn_scale(self, values: Array, forearms_mm: Array) -> TurnScale:
        """A slide of r for a turn of 1 rad; no turn is too far."""
        pinion_mm = values[0]
        return TurnScale(pinion_mm, SLIDE_STEP_MM / pinion_mm, math.inf)

    @override
    def apart(self, turn: Array) -> Array:
        """(-θ, 0)."""
        return np.array([-turn, np.zeros_like(turn)])

    @override
    def apart_by_turn(self, turn: Array) -> Array:
        """(-1, 0)."""
        return np.array([-np.ones_like(turn), np.zeros_like(turn)])
