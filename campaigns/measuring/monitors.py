"""Monitors of a run: the innovation gate, drift, the air."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import dist, isfinite

import numpy as np

from campaigns.arrays import Array
from campaigns.estimation.incremental_fit import IncrementalGaussNewton
from campaigns.estimation.information import LinearizedModel
from campaigns.journal.records import Outcome
from campaigns.measuring.rules import GateRules
from drivers.values import Vector3, Weather

SIGMAS = 4.0
AGREEING = 2
"""Shots that agree in their distance; of one alone nobody knows whether it saw the right target."""
WRONG = "a wrong target or a wrong pose"
ALARM_ENDS_AT = 0.8
"""Share of the limit below which an alarm ends: above the noise of one that is just at it."""


@dataclass(frozen=True, slots=True)
class GateDecision:
    """Decision of the gate on a shot. `refusal` is empty when it may count."""

    predicted_in_tracker_mm: Vector3 | None
    residual_mm: float | None
    refusal: str


class InnovationGate:
    """Gate that compares every shot with what the accepted ones let one expect.

    `new_fit` gives a running fit that knows no shot yet.
    """

    def __init__(self, rules: GateRules, new_fit: Callable[[], IncrementalGaussNewton]) -> None:
        self._rules = rules
        self._new_fit = new_fit
        self._running = new_fit()
        self._accepted: dict[int, Outcome] = {}

    def judge(self, joints: tuple[float, ...], point_in_tracker_mm: Vector3) -> GateDecision:
        """A point too far from where it should be is a wrong target or a wrong pose, never data.

        The limit follows what is known: near once the shots so far fix robot and frame.
        """
        read, point = np.array(joints), np.array(point_in_tracker_mm)
        predicted = self._running.predict(read)
        if predicted is None or predicted.std_mm > self._rules.distance_mm:
            return GateDecision(None, None, self._fault_of_distances(read, point))
        residual_mm = float(np.linalg.norm(point - predicted.point_mm))
        near_mm = self._rules.fitted_mm + SIGMAS * predicted.std_mm
        limit_mm = min(near_mm, self._rules.distance_mm)
        refusal = ""
        if not residual_mm <= limit_mm:
            refusal = (
                f"{residual_mm:.2f} mm from the predicted point, limit {limit_mm:.2f} mm: {WRONG}"
            )
        return GateDecision(vector(predicted.point_mm), residual_mm, refusal)

    def accept(self, outcome: Outcome) -> None:
        """Let an accepted shot teach the next prediction."""
        self._accepted[outcome.shot] = outcome
        self._teach(outcome)

    def forget(self, shots: Iterable[int]) -> None:
        """Unlearn shots that were accepted and do not count any more."""
        for shot in shots:
            del self._accepted[shot]
        self._running = self._new_fit()
        for outcome in self._accepted.values():
            self._teach(outcome)

    @property
    def accepted(self) -> tuple[Outcome, ...]:
        """The shots that count, in the order in which they came."""
        return tuple(self._accepted.values())

    @property
    def linearized(self) -> LinearizedModel | None:
        """The running fit of the first of them, or of all; None while there is none."""
        return self._running.linearized

    def expected_point_mm(self, joints: tuple[float, ...]) -> Vector3 | None:
        """Where to point the tracker for these joints; None while the frame is unknown."""
        predicted = self._running.predict(np.array(joints))
        return None if predicted is None else vector(predicted.point_mm)

    def nearest_point_mm(self, joints: tuple[float, ...]) -> Vector3 | None:
        """Where the accepted shot with the nearest joints was; None before two shots agree."""
        if len(self._accepted) < AGREEING:
            return None
        nearest = min(
            self._accepted.values(),
            key=lambda outcome: float(np.abs(np.subtract(outcome.joints, joints)).max()),
        )
        return nearest.point_in_tracker_mm

    def _teach(self, outcome: Outcome) -> None:
        self._running.add(np.array(outcome.joints), np.array(outcome.point_in_tracker_mm))

    def _fault_of_distances(self, joints: Array, point: Array) -> str:
        """While robot and frame are not known yet: distances to the shots before."""
        fault_mm = self._running.max_distance_innovation_mm(joints, point)
        limit_mm = self._rules.distance_mm
        if not isfinite(fault_mm):
            return "the robot's model cannot be assembled at the joints that were read"
        if fault_mm <= limit_mm:
            return ""
        return (
            f"the distance to an earlier shot is {fault_mm:.2f} mm off, "
            f"limit {limit_mm:g} mm: {WRONG}"
        )


class DriftMonitor:
    """Compares the drift shots of a series with its first one."""

    def __init__(self, limit_mm: float, first_mm: Vector3 | None) -> None:
        self.limit_mm = limit_mm
        self._first_mm = first_mm

    def moved_mm(self, point_in_tracker_mm: Vector3) -> float | None:
        """How far a drift shot is from the first one; None for the first one itself."""
        if self._first_mm is None:
            self._first_mm = point_in_tracker_mm
            return None
        return dist(self._first_mm, point_in_tracker_mm)


class TemperatureMonitor:
    """Watches the air's temperature, and says when an alarm begins and when it ends."""

    def __init__(self, limit_degC: float, first: Weather | None) -> None:
        self._limit_degC = limit_degC
        self._first = first
        self._alarmed = False

    def news(self, weather: Weather | None) -> str:
        """What to tell the operator of this shot's air; empty when there is nothing new."""
        if weather is None:
            return ""
        self._first = self._first or weather
        change_degC = weather.temperature_degC - self._first.temperature_degC
        limit_degC = self._limit_degC * (ALARM_ENDS_AT if self._alarmed else 1.0)
        if (abs(change_degC) > limit_degC) is self._alarmed:
            return ""
        self._alarmed = not self._alarmed
        state = "has changed by" if self._alarmed else "is back within its limit:"
        limit = f"limit {self._limit_degC:g} °C"
        return f"the air {state} {change_degC:+.2f} °C since the start, {limit}"


def vector(values: Array) -> Vector3:
    """Three floats."""
    x, y, z = (float(value) for value in values)
    return x, y, z
