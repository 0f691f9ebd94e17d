"""Monitors of a run: the innovation gate, drift, the air."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from math import dist, isfinite

import numpy as np

from campaigns.arrays import Array
from campaigns.journal.records import Event, Outcome
from campaigns.measuring.running_fit import RunningFit
from campaigns.settings.sections import GateConfig
from drivers.values import Vector3, Weather, vector

SIGMAS = 4.0
POINTING_STD_MM = 20.0
"""Standard deviation of a prediction, up to which the tracker is pointed there; it searches 50."""
SAME_POSE = 0.002
"""Largest difference of joints, rad or mm, of a pose that is taken again."""
WRONG = "a wrong target or a wrong pose"
FIRST_SHOTS = 12
"""Shots among which one that took the wrong target is looked for; later the fit is firm."""
STANDING_MM = 1.0
"""Points nearer to each other, of a robot that moved, are of a reflector that stands elsewhere."""
ALARM_ENDS_AT = 0.8
"""Share of the limit below which an alarm ends: above the noise of one that is just at it."""


@dataclass(frozen=True, slots=True)
class GateDecision:
    """Decision of the gate on a shot. `refusal` is empty when it may count."""

    predicted_in_tracker_mm: Vector3 | None
    residual_mm: float | None
    refusal: str
    misfit: float = 0.0
    """Distance from the expected over its limit."""


class InnovationGate:
    """Gate that compares every shot with what the accepted ones let one expect.

    `new_fit` gives a running fit that knows no shot yet.
    """

    def __init__(self, rules: GateConfig, new_fit: Callable[[], RunningFit]) -> None:
        self._rules = rules
        self._new_fit = new_fit
        self._running = new_fit()
        self._accepted: dict[int, Outcome] = {}

    def judge(self, joints: tuple[float, ...], point_in_tracker_mm: Vector3) -> GateDecision:
        """A point too far from where it should be is a wrong target or a wrong pose, never data.

        The limit follows what is known: near once the shots so far fix robot and frame.
        """
        read, point = np.array(joints), np.array(point_in_tracker_mm)
        expected_mm, std_mm = self._running.predict(read) or (None, np.inf)
        if expected_mm is None or std_mm > self._rules.distance_mm:
            refusal, misfit = self._fault_of_distances(read, point)
            return GateDecision(None, None, refusal, misfit)
        residual_mm = float(np.linalg.norm(point - expected_mm))
        near_mm = self._rules.fitted_mm + SIGMAS * std_mm
        limit_mm = min(near_mm, self._rules.distance_mm)
        refusal = ""
        if not residual_mm <= limit_mm:
            refusal = (
                f"{residual_mm:.2f} mm from the predicted point, limit {limit_mm:.2f} mm: {WRONG}"
            )
        return GateDecision(vector(expected_mm), residual_mm, refusal, residual_mm / limit_mm)

    def accept(self, outcome: Outcome) -> None:
        """Let an accepted shot teach the next prediction."""
        self._accepted[outcome.shot] = outcome
        self._running.add(np.array(outcome.joints), np.array(outcome.point_in_tracker_mm))

    def restart(self, outcomes: Iterable[Outcome]) -> None:
        """Forget all, and accept these shots at once."""
        self._accepted = {outcome.shot: outcome for outcome in outcomes}
        self._running.restart(
            np.array([each.joints for each in self.accepted]),
            np.array([each.point_in_tracker_mm for each in self.accepted]),
        )

    def reset(self, shots: Iterable[int]) -> None:
        """Take out shots that were accepted and do not count any more."""
        voided = {*shots}
        self.restart([each for each in self.accepted if each.shot not in voided])

    def without(self, shot: int) -> "InnovationGate":
        """Return a gate that knows all accepted shots but one."""
        gate = InnovationGate(self._rules, self._new_fit)
        for number, outcome in self._accepted.items():
            if number != shot:
                gate.accept(outcome)
        return gate

    def suspects(self, refused: Outcome) -> tuple[Outcome, ...]:
        """Shots without which a refused one goes with all others, the likeliest to be wrong first.

        Only among the first shots of a series: one that took the wrong target makes all others
        look wrong. The very first, which nothing could contradict, is the likeliest.
        """
        if len(self._accepted) > FIRST_SHOTS:
            return ()
        first = next(iter(self._accepted), None)
        found: list[tuple[float, Outcome]] = []
        for shot, outcome in self._accepted.items():
            others = self.without(shot)
            if others.judge(refused.joints, refused.point_in_tracker_mm).refusal:
                continue
            others.accept(refused)
            judged = others.judge(outcome.joints, outcome.point_in_tracker_mm)
            found.append((np.inf if shot == first else judged.misfit, outcome))
        found.sort(key=lambda each: -each[0])
        return tuple(outcome for _, outcome in found)

    def is_replaced(self, suspect: Outcome, again: Outcome, refused: Outcome) -> bool:
        """Whether a suspect measured again is elsewhere, where it goes with the refused shot."""
        moved_mm = dist(suspect.point_in_tracker_mm, again.point_in_tracker_mm)
        if moved_mm <= self._rules.fitted_mm:
            return False
        others = self.without(suspect.shot)
        others.accept(refused)
        return not others.judge(again.joints, again.point_in_tracker_mm).refusal

    def standing(self, refused: Outcome) -> tuple[Outcome, ...]:
        """Shots whose point is that of a refused one, although the robot was elsewhere.

        Of a reflector that stands still, all of them.
        """
        point_mm = refused.point_in_tracker_mm
        alone = InnovationGate(self._rules, self._new_fit)
        alone.accept(refused)
        return tuple(
            each
            for each in self._accepted.values()
            if dist(each.point_in_tracker_mm, point_mm) <= STANDING_MM
            and alone.judge(each.joints, each.point_in_tracker_mm).refusal
        )

    @property
    def accepted(self) -> tuple[Outcome, ...]:
        """The shots that count, in the order in which they came."""
        return tuple(self._accepted.values())

    def expected_point_mm(self, joints: tuple[float, ...]) -> Vector3 | None:
        """Where to point the tracker for these joints; None while nobody can say well enough.

        By the running fit, or where a shot at the same pose was.
        """
        predicted = self._running.predict(np.array(joints))
        if predicted is not None and predicted[1] <= POINTING_STD_MM:
            return vector(predicted[0])
        same = (
            outcome.point_in_tracker_mm
            for outcome in self._accepted.values()
            if is_same_pose(outcome.joints, joints)
        )
        return next(same, None)

    def _fault_of_distances(self, joints: Array, point: Array) -> tuple[str, float]:
        """While robot and frame are not known yet: distances to the shots before; over limit."""
        fault_mm = self._running.distance_misfit_mm(joints, point)
        limit_mm = self._rules.distance_mm
        if not isfinite(fault_mm):
            return "the robot's model cannot be assembled at the joints that were read", fault_mm
        if fault_mm <= limit_mm:
            return "", fault_mm / limit_mm
        return (
            f"the distance to an earlier shot is {fault_mm:.2f} mm off, "
            f"limit {limit_mm:g} mm: {WRONG}"
        ), fault_mm / limit_mm


def is_same_pose(joints: tuple[float, ...], others: tuple[float, ...]) -> bool:
    """Whether two readings of the joints, rad or mm, are of one pose that is taken again."""
    return bool(np.abs(np.subtract(joints, others)).max() <= SAME_POSE)


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

    def reset(self, point_in_tracker_mm: Vector3 | None = None) -> None:
        """The next shot is the first; of a point that does not count any more, if that was it."""
        if point_in_tracker_mm in (None, self._first_mm):
            self._first_mm = None


class TemperatureMonitor:
    """Watches the air's temperature, and says when an alarm begins and when it ends."""

    def __init__(self, limit_degC: float, first: Weather | None) -> None:
        self._limit_degC = limit_degC
        self._first = first
        self._alarmed = False

    def events(self, weather: Weather | None) -> tuple[Event, ...]:
        """What to tell the operator of this shot's air, if there is anything new."""
        if weather is None:
            return ()
        self._first = self._first or weather
        change_degC = weather.temperature_degC - self._first.temperature_degC
        limit_degC = self._limit_degC * (ALARM_ENDS_AT if self._alarmed else 1.0)
        if (abs(change_degC) > limit_degC) is self._alarmed:
            return ()
        self._alarmed = not self._alarmed
        state = "has changed by" if self._alarmed else "is back within its limit:"
        limit = f"limit {self._limit_degC:g} °C"
        text = f"the air {state} {change_degC:+.2f} °C since the start, {limit}"
        return (Event("temperature alarm", text),)
