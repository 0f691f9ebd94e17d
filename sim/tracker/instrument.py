"""The simulated laser tracker: initialises, warms up, follows its beam, measures with noise."""

import math
from collections import deque
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from drivers.values import Measurement, Vector3, Weather, vector
from sim.faults import Counted, Fault, FaultScript
from sim.geometry import Array
from sim.random_streams import Attempts, Purpose, WorkedTime, generator
from sim.tracker.beam import Aim, Beam, Scene
from sim.tracker.optics import direction_of
from sim.tracker.section import S_PER_H, TrackerSection

SLEW_RAD_PER_S = math.radians(90.0)
FOREVER_S = 1e9
EVENTS_KEPT = 100
"""Of a tracker whose protocol reports nothing unasked."""
PPM = 1e-6


@dataclass(frozen=True, slots=True)
class TakenShot:
    """Record of truth of one shot: what was reported, of which reflector, where the robot stood.

    The place is the encoders' in whole microdegrees. Records from before have no true point.
    """

    point_in_tracker_mm: Vector3
    on: str
    robot_target: tuple[int, ...]
    true_in_tracker_mm: Vector3 | None = None
    """Where the reflector really was."""
    worked_s: float | None = None
    """Of the cell, from which the warmth of its parts follows."""


class SimulatedTracker:
    """A tracker with its own clockwork: every call gets the time."""

    vendor = "pkmcal"
    model = "simulated tracker"
    name = "SIM-LT"
    firmware = "1.0"

    def __init__(
        self,
        section: TrackerSection,
        scene: Scene,
        beam: Beam,
        *,
        initialised: bool,
        warm: bool,
        selected: int,
        seed: int,
        faults: FaultScript,
        worked: WorkedTime,
        attempts: Attempts,
        taken: Iterable[TakenShot] = (),
    ) -> None:
        self.taken = list(taken)
        """All shots that were ever reported, oldest first. A back door for tests."""
        self.serial = section.serial
        self.reflectors = section.reflectors
        self.selected = selected
        self.search_radius_mm = 50.0
        self.search_timeout_s = 10.0
        self.beam = beam
        self.attempts = attempts
        self._section = section
        self._scene = scene
        self._seed = seed
        self._faults = faults
        self._worked = worked
        self.is_initialised = initialised
        self.is_warm = warm or section.warm_up_s <= 0.0
        self._action: tuple[float, Callable[[float], None]] | None = None
        """Action that takes time: when it ends, and what happens then."""
        self._measuring_s: float | None = None
        self._events: deque[str] = deque(maxlen=EVENTS_KEPT)

    def initialised(self, now_s: float) -> bool:
        """Whether it has been initialised."""
        self.advance(now_s)
        return self.is_initialised

    def laser_warm(self, now_s: float) -> bool:
        """Whether the laser is stable."""
        self.advance(now_s)
        return self.is_warm

    def beam_locked(self, now_s: float) -> bool:
        """Whether the beam is on a reflector: any reflector."""
        self.advance(now_s)
        return self.beam.locked_on is not None

    def busy(self, now_s: float) -> bool:
        """Whether the head is moving, searching or initialising."""
        self.advance(now_s)
        return self._action is not None

    def weather(self, now_s: float) -> tuple[float, float, float]:  # noqa: ARG002 - all calls pass it
        """Return the temperature °C, pressure hPa, humidity %, as its own station reads them."""
        air = self._section.air
        warmer = air.drift_degC_per_h * self._worked.seconds / S_PER_H
        return air.temperature_degC + warmer, air.pressure_hPa, air.humidity_percent

    def direction(self, now_s: float) -> tuple[float, float]:
        """Return the direction of the head: horizontal angle and zenith angle, rad."""
        self.advance(now_s)
        return direction_of(self.beam.point_in_tracker_mm(now_s))

    def live_point(self, now_s: float) -> Vector3 | None:
        """Return the followed reflector's centre in the tracker's frame, mm; None if not locked."""
        if not self.beam_locked(now_s):
            return None
        return vector(self.beam.point_in_tracker_mm(now_s))

    def events(self) -> list[str]:
        """Return the events since this was last asked, up to the last call.

        "initialised", "warmed_up", "beam_lost", "beam_found".
        """
        taken = list(self._events)
        self._events.clear()
        return taken

    def next_event_s(self) -> float | None:
        """Return the time of the next event, if one comes by itself; `advance` makes it happen."""
        warm_s = None if self.is_warm else self._section.warm_up_s
        end_s = None if self._action is None else self._action[0]
        times = [t for t in (warm_s, end_s, self.beam.next_cut_s()) if t is not None]
        return min(times, default=None)

    def select_reflector(self, identifier: int) -> bool:
        """Use another reflector definition; false when there is no such one."""
        if all(reflector.id != identifier for reflector in self.reflectors):
            return False
        self.selected = identifier
        return True

    def initialise(self, now_s: float) -> float:
        """Start initialising and say how long it takes, s. At its end the head goes back.

        It then looks for the reflector where it pointed before.
        """
        self.advance(now_s)
        aim = self._aim_here(now_s)
        self.beam.release()
        self.is_initialised = False

        def finish(end_s: float) -> None:
            self.is_initialised = True
            self._events.append("initialised")
            self._lock(aim, end_s)

        return self._begin(self._section.initialise_s, finish, now_s)

    def go_to(self, point_in_tracker_mm: Vector3, now_s: float) -> float:
        """Start pointing there and say how long it takes, s.

        At the end `beam_locked` says whether a reflector was found within the search radius.
        """
        self.advance(now_s)
        aim = Aim(point_in_tracker_mm, self.search_radius_mm, any_distance=False)
        return self._search(aim, now_s)

    def find(self, distance_mm: float, now_s: float) -> float:  # noqa: ARG002 - it searches all
        """Start searching around the present direction and say how long it takes, s."""
        self.advance(now_s)
        return self._search(self._aim_here(now_s), now_s)

    def begin_measurement(self, measuring_time_s: float, now_s: float) -> float | None:
        """Start measuring and say when it ends; nothing when the beam is on no reflector."""
        if not self.beam_locked(now_s):
            return None
        fault = self._faults.next(Counted.MEASUREMENT)
        if fault is not None:
            self._break(fault, now_s + 0.5 * measuring_time_s)
        self._measuring_s = measuring_time_s
        return now_s + measuring_time_s

    def finish_measurement(self, now_s: float) -> Measurement | None:
        """Return the shot, or nothing when the beam was lost meanwhile."""
        locked, measured_s = self.beam_locked(now_s), self._measuring_s
        self._measuring_s = None
        if not locked or measured_s is None:
            return None
        shot = self._shot(now_s)
        self._worked.seconds += measured_s
        return shot

    def advance(self, now_s: float) -> None:
        """Let happen what is due by now."""
        if not self.is_warm and now_s >= self._section.warm_up_s:
            self.is_warm = True
            self._events.append("warmed_up")
        if self.beam.is_lost(now_s):
            self._measuring_s = None
            self._events.append("beam_lost")
        if self._action is not None and now_s >= self._action[0]:
            (_, finish), self._action = self._action, None
            finish(now_s)

    def _begin(self, duration_s: float, finish: Callable[[float], None], now_s: float) -> float:
        self._measuring_s = None
        self._action = now_s + duration_s, finish
        return duration_s

    def _search(self, aim: Aim, now_s: float) -> float:
        here_mm = self.beam.point_in_tracker_mm(now_s)
        slew_s = _turn_rad(here_mm, np.array(aim.point_in_tracker_mm)) / SLEW_RAD_PER_S
        found = self.beam.candidate(aim, now_s + slew_s) is not None
        self.beam.release()
        duration_s = slew_s + (0.5 if found else self.search_timeout_s)
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
        """Point with noise, and the covariance it was drawn by."""
        true_mm = self.beam.point_in_tracker_mm(now_s) * (1.0 + PPM * self._section.scale_ppm)
        spread_mm = self._section.noise.spread_mm(true_mm)
        key = self._scene.robot_target()
        draw = generator(self._seed, Purpose.SHOT, *key, self.attempts.next(key))
        measured_mm = true_mm + spread_mm @ draw.standard_normal(3)
        rows = [vector(row) for row in spread_mm @ spread_mm.T]
        weather = Weather(*self.weather(now_s))
        assert self.beam.locked_on is not None, "without a lock there is no shot"
        told, true, worked_s = vector(measured_mm), vector(true_mm), self._worked.seconds
        self.taken.append(TakenShot(told, self.beam.locked_on, key, true, worked_s))
        return Measurement(vector(measured_mm), (rows[0], rows[1], rows[2]), weather)


def _turn_rad(first_mm: Array, second_mm: Array) -> float:
    """Turn of the head, about its faster axis' angle."""
    (hz, vt), (to_hz, to_vt) = direction_of(first_mm), direction_of(second_mm)
    turn_rad = max(abs(math.remainder(to_hz - hz, 2.0 * math.pi)), abs(to_vt - vt))
    return turn_rad if math.isfinite(turn_rad) else 0.0
