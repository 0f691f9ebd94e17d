"""The simulated laser tracker: initialises, warms up, follows its beam, measures with noise.

Theory of operation. Like the controller it has no timer: every call brings the time, and `advance`
first carries out what is due. At most one action (initialising, searching) is under way; it has an
end and a step to take there. A measurement is begun, lasts, and is finished by its caller; losing
the beam or starting an action in between cancels it.

The error model of a shot (`_shot`), for a spherical instrument:

1. the reflector's true centre in the tracker's frame, times 1 + the scale error of the distance
   meter, which no covariance states;
2. a normal draw along the beam and across it in azimuth and elevation, with standard uncertainties
   of a + b · distance from a data sheet's limits, over √3 (sim/tracker/optics.py);
3. the point comes with the covariance by which it was drawn: the simulated tracker states the
   truth about its scatter.

The draw's stream is that of the joint target and the attempt there (sim/random_streams.py). Each
shot is recorded with the truth (`taken`), against which tests compare what campaigns report.
"""

import math
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from drivers.values import Measurement, Vector3, Weather, vector
from sim.faults import Counted, Fault, FaultScript
from sim.geometry import Array
from sim.random_streams import Attempts, WorkedTime
from sim.tracker.beam import Aim, Beam
from sim.tracker.optics import direction_of
from sim.tracker.section import S_PER_H, TrackerSection

SLEW_RAD_PER_S = math.radians(90.0)
"""Speed of the head."""
FOREVER_S = 1e9
LOCKING_S = 0.5
"""Duration of a search that finds a reflector, after the turn of the head."""
EVENTS_KEPT = 100
"""Events that a tracker keeps whose protocol does not report them."""
PPM = 1e-6


class Action(NamedTuple):
    """Action of the head that takes time."""

    end_s: float
    finish: Callable[[float], None]
    """Step to take at the end, with its time."""


@dataclass(frozen=True, slots=True)
class TakenShot:
    """Record of one shot and the truth about it. Records of older versions have no true point."""

    point_in_tracker_mm: Vector3
    """Point that was reported."""
    on: str
    """Reflector on which the beam was."""
    robot_target: tuple[int, ...]
    """Key of the joints at which the robot stood (`target_key`)."""
    true_in_tracker_mm: Vector3 | None = None
    """True place of the reflector, with the scale error."""
    worked_s: float | None = None
    """Worked time of the cell, from which the warmth of its parts follows."""


@dataclass(frozen=True, slots=True)
class TrackerState:
    """State of a tracker at the start: as delivered, or as an earlier process left it."""

    is_initialised: bool
    is_warm: bool
    selected_reflector: int
    """Number of the reflector definition in use."""
    taken: tuple[TakenShot, ...] = ()
    """All shots so far."""


class SimulatedTracker:
    """A tracker with its own clockwork: every call gets the time."""

    vendor = "pkmcal"
    model = "simulated tracker"
    name = "SIM-LT"
    firmware = "1.0"

    def __init__(
        self,
        section: TrackerSection,
        beam: Beam,
        state: TrackerState,
        *,
        faults: FaultScript,
        worked: WorkedTime,
        attempts: Attempts,
    ) -> None:
        self.taken = list(state.taken)
        """All shots that were ever reported, oldest first. A back door for tests."""
        self.serial = section.serial
        self.reflectors = section.reflectors
        self.selected = state.selected_reflector
        self.search_radius_mm = 50.0
        self.search_timeout_s = 10.0
        self.beam = beam
        self.attempts = attempts
        self._section = section
        self._faults = faults
        self._worked = worked
        self.is_initialised = state.is_initialised
        self.is_warm = state.is_warm or section.warm_up_s <= 0.0
        self._action: Action | None = None
        """Action under way; None if there is none."""
        self._measuring_s: float | None = None
        self._begins_mm: Vector3 | None = None
        """Followed reflector's centre where the latest measurement began."""
        self.swept_mm: Vector3 = (0.0, 0.0, 0.0)
        """How far the reflector moved in the latest measurement."""
        self._events: deque[str] = deque(maxlen=EVENTS_KEPT)

    def initialised(self, now_s: float) -> bool:
        """Whether the tracker has been initialised."""
        self.advance(now_s)
        return self.is_initialised

    def laser_warm(self, now_s: float) -> bool:
        """Whether the laser is stable."""
        self.advance(now_s)
        return self.is_warm

    def beam_locked(self, now_s: float) -> bool:
        """Whether the beam is on any reflector."""
        self.advance(now_s)
        return self.beam.locked_on is not None

    def busy(self, now_s: float) -> bool:
        """Whether the head is moving, searching or initialising."""
        self.advance(now_s)
        return self._action is not None

    def weather(self, now_s: float) -> tuple[float, float, float]:  # noqa: ARG002 - all calls pass it
        """Return the temperature °C, pressure hPa and humidity % of its weather station."""
        air = self._section.air
        warmer = air.drift_degC_per_h * self._worked.seconds / S_PER_H
        return air.temperature_degC + warmer, air.pressure_hPa, air.humidity_percent

    def direction(self, now_s: float) -> tuple[float, float]:
        """Return the head's direction: horizontal and zenith angle, rad."""
        self.advance(now_s)
        return direction_of(self.beam.point_in_tracker_mm(now_s))

    def live_point(self, now_s: float) -> Vector3 | None:
        """Return the followed reflector's centre in the tracker's frame, mm; None if not locked."""
        if not self.beam_locked(now_s):
            return None
        return vector(self.beam.point_in_tracker_mm(now_s))

    def events(self) -> list[str]:
        """Take the events since the last call: initialised, warmed_up, beam_lost, beam_found.

        Later ones come only after a call with the time, such as `advance`.
        """
        events = list(self._events)
        self._events.clear()
        return events

    def next_event_s(self) -> float | None:
        """Return the time of the next event that `advance` will carry out; None if none is due."""
        warm_s = None if self.is_warm else self._section.warm_up_s
        end_s = None if self._action is None else self._action.end_s
        times = [t for t in (warm_s, end_s, self.beam.next_cut_s()) if t is not None]
        return min(times, default=None)

    def select_reflector(self, identifier: int) -> bool:
        """Use another reflector definition; return whether there is such a definition."""
        if all(reflector.id != identifier for reflector in self.reflectors):
            return False
        self.selected = identifier
        return True

    def initialise(self, now_s: float) -> float:
        """Start initialising and return its duration, s.

        At its end the head looks for the reflector where it pointed before.
        """
        self.advance(now_s)
        # initialising turns the head, which loses the beam
        aim = self._aim_here(now_s)
        self.beam.release()
        self.is_initialised = False

        def finish(end_s: float) -> None:
            self.is_initialised = True
            self._events.append("initialised")
            self._lock(aim, end_s)

        return self._begin(self._section.initialise_s, finish, now_s)

    def go_to(self, point_in_tracker_mm: Vector3, now_s: float) -> float:
        """Start pointing at a place and return the duration, s.

        At the end `beam_locked` says whether a reflector was found within the search radius.
        """
        self.advance(now_s)
        aim = Aim(point_in_tracker_mm, self.search_radius_mm, any_distance=False)
        return self._search(aim, now_s)

    def find(self, distance_mm: float, now_s: float) -> float:  # noqa: ARG002 - it searches all
        """Start searching around the present direction, at any distance; return the duration, s."""
        self.advance(now_s)
        return self._search(self._aim_here(now_s), now_s)

    def begin_measurement(self, measuring_time_s: float, now_s: float) -> float | None:
        """Start measuring and return its end; None if the beam is on no reflector."""
        if not self.beam_locked(now_s):
            return None
        fault = self._faults.next(Counted.MEASUREMENT)
        if fault is not None:
            # in the middle, where the point would be half measured
            self._break(fault, now_s + 0.5 * measuring_time_s)
        self._measuring_s, self._begins_mm = measuring_time_s, self.live_point(now_s)
        return now_s + measuring_time_s

    def finish_measurement(self, now_s: float) -> Measurement | None:
        """Return the shot; None if the beam was lost meanwhile."""
        locked, measured_s = self.beam_locked(now_s), self._measuring_s
        self._measuring_s = None
        if not locked or measured_s is None:
            return None
        begins_mm, ends_mm = self._begins_mm or (0.0, 0.0, 0.0), self.live_point(now_s)
        self.swept_mm = vector(np.subtract(ends_mm or begins_mm, begins_mm))
        # worked time grows after the shot: the measurement is of the state at its beginning
        shot = self._shot(now_s)
        self._worked.seconds += measured_s
        return shot

    def advance(self, now_s: float) -> None:
        """Carry out what is due by now: warming up, losing the beam, the end of an action."""
        # the beam before the action: an action's end may lock it on another reflector
        if not self.is_warm and now_s >= self._section.warm_up_s:
            self.is_warm = True
            self._events.append("warmed_up")
        if self.beam.is_lost(now_s):
            self._measuring_s = None
            self._events.append("beam_lost")
        if self._action is not None and now_s >= self._action.end_s:
            # cleared before the step is taken, which may begin another action
            action, self._action = self._action, None
            action.finish(now_s)

    def _begin(self, duration_s: float, finish: Callable[[float], None], now_s: float) -> float:
        # the head has one action: a new one replaces the present one, and ends a measurement
        self._measuring_s = None
        self._action = Action(now_s + duration_s, finish)
        return duration_s

    def _search(self, aim: Aim, now_s: float) -> float:
        """Start turning to a place and searching there; return the duration, s."""
        # What the search will find decides how long it lasts: it is looked up in advance, for the
        # time when the head arrives. At the end it is searched again: the robot may have moved.
        here_mm = self.beam.point_in_tracker_mm(now_s)
        slew_s = _turn_rad(here_mm, np.array(aim.point_in_tracker_mm)) / SLEW_RAD_PER_S
        finds_one = self.beam.candidate(aim, now_s + slew_s) is not None
        self.beam.release()
        duration_s = slew_s + (LOCKING_S if finds_one else self.search_timeout_s)
        return self._begin(duration_s, lambda end_s: self._lock(aim, end_s), now_s)

    def _lock(self, aim: Aim, now_s: float) -> None:
        if self.beam.search(aim, now_s):
            self._events.append("beam_found")

    def _aim_here(self, now_s: float) -> Aim:
        here_mm = self.beam.point_in_tracker_mm(now_s)
        return Aim(vector(here_mm), self.search_radius_mm, any_distance=True)

    def _break(self, fault: Fault, at_s: float) -> None:
        if fault.kind == "wrong_target":
            self.beam.confuse()
        else:
            self.beam.cut(at_s, FOREVER_S if fault.seconds is None else fault.seconds)

    def _shot(self, now_s: float) -> Measurement:
        """Return a point with noise and the covariance by which it was drawn."""
        true_mm = self.beam.point_in_tracker_mm(now_s) * (1.0 + PPM * self._section.scale_ppm)
        spread_mm = self._section.noise.spread_mm(true_mm)
        target = self.beam.scene.robot_target()
        draw = self.attempts.next_generator(target)
        # S z with z standard normal has covariance S Sᵀ
        measured = vector(true_mm + spread_mm @ draw.standard_normal(3))
        rows = [vector(row) for row in spread_mm @ spread_mm.T]
        weather = Weather(*self.weather(now_s))
        assert self.beam.locked_on is not None, "without a lock there is no shot"
        true, worked_s = vector(true_mm), self._worked.seconds
        self.taken.append(TakenShot(measured, self.beam.locked_on, target, true, worked_s))
        return Measurement(measured, (rows[0], rows[1], rows[2]), weather)


def _turn_rad(first_mm: Array, second_mm: Array) -> float:
    """Return the larger of the turns of the head's two axes, which turn at once, rad."""
    (from_hz, from_vt), (to_hz, to_vt) = direction_of(first_mm), direction_of(second_mm)
    turn_rad = max(abs(math.remainder(to_hz - from_hz, 2.0 * math.pi)), abs(to_vt - from_vt))
    return turn_rad if math.isfinite(turn_rad) else 0.0
