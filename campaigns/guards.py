"""Whether a shot can be data: the measured point against the predicted one, drift, the air."""

from dataclasses import dataclass

import numpy as np

from campaigns.numerics.geometry import Array
from campaigns.numerics.running import RunningFit
from campaigns.rules import GateRules
from drivers.values import Vector3, Weather

SIGMAS = 4.0
WRONG = "a wrong target or a wrong pose"


@dataclass(frozen=True, slots=True)
class Judgement:
    """What the gate says of a shot. `refusal` is empty when it may count."""

    predicted_in_tracker_mm: Vector3 | None
    residual_mm: float | None
    refusal: str


class Gate:
    """Compares every shot with what the shots before it let one expect."""

    def __init__(self, rules: GateRules, running: RunningFit) -> None:
        self._rules = rules
        self._running = running

    def judge(self, joints_rad: tuple[float, ...], point_mm: Vector3) -> Judgement:
        """A point too far from where it should be is a wrong target or a wrong pose, never data.

        The limit follows what is known: near once the shots so far fix robot and frame.
        """
        joints, point = np.array(joints_rad), np.array(point_mm)
        predicted = self._running.predict(joints)
        if predicted is None or predicted.std_mm > self._rules.distance_mm:
            return self._by_distances(joints, point)
        residual = float(np.linalg.norm(point - predicted.point_mm))
        near_mm = self._rules.fitted_mm + SIGMAS * predicted.std_mm
        limit_mm = min(near_mm, self._rules.distance_mm)
        refusal = (
            f"{residual:.2f} mm from the predicted point, limit {limit_mm:.2f} mm: {WRONG}"
            if residual > limit_mm
            else ""
        )
        return Judgement(vector(predicted.point_mm), residual, refusal)

    def accept(self, joints_rad: tuple[float, ...], point_mm: Vector3) -> None:
        """Let an accepted shot teach the next prediction."""
        self._running.add(np.array(joints_rad), np.array(point_mm))

    def expected_point_mm(self, joints_rad: tuple[float, ...]) -> Vector3 | None:
        """Where to point the tracker for these joints; None while the frame is unknown."""
        predicted = self._running.predict(np.array(joints_rad))
        return None if predicted is None else vector(predicted.point_mm)

    def _by_distances(self, joints: Array, point: Array) -> Judgement:
        fault_mm = self._running.distance_fault_mm(joints, point)
        limit_mm = self._rules.distance_mm
        refusal = (
            f"a distance to an earlier shot is {fault_mm:.2f} mm off, limit {limit_mm:g} mm: {WRONG}"
            if fault_mm > limit_mm
            else ""
        )
        return Judgement(None, None, refusal)


def vector(values: Array) -> Vector3:
    """Three floats."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def temperature_alarm(first: Weather, now: Weather, limit_degC: float) -> str:  # noqa: N803 - unit
    """What to tell the operator when the air has changed too much; empty when it has not."""
    change = now.temperature_degC - first.temperature_degC
    if abs(change) <= limit_degC:
        return ""
    return f"the air has changed by {change:+.2f} °C since the start, limit {limit_degC:g} °C"


def moved_mm(first_mm: Vector3, now_mm: Vector3) -> float:
    """Distance between two points."""
    return float(np.linalg.norm(np.subtract(now_mm, first_mm)))
