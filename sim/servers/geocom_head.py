"""A simulated total station's telescope: turns, searches, aims and follows on a tracker's beam."""

import math

import numpy as np

from drivers.wire.geocom_constants import LockStatus, Result
from sim.geometry import Array
from sim.servers.geocom_outcome import DONE, Later, Outcome, refusal
from sim.tracker.beam import Aim
from sim.tracker.instrument import SLEW_RAD_PER_S, SimulatedTracker

SEARCH_S = 0.5
AIM_S = 0.5
LOCK_S = 0.2
FIELD_RAD = 0.02
"""In which target recognition sees a prism without searching."""


class Head:
    """Where the telescope looks, and whether it follows a prism.

    Directions are Hz, clockwise from north (the y axis), and V from the zenith. The tracker's beam
    stands for the telescope; it sees prisms as the tracker sees its reflectors.
    """

    def __init__(self, tracker: SimulatedTracker) -> None:
        self._tracker = tracker
        self._follows = False
        self.recognition = False
        """Whether target recognition is on."""
        self.lock_mode = False
        self.orientation_rad = 0.0
        """Added to every Hz."""

    def lock_status(self, now_s: float) -> LockStatus:
        """Whether it follows a prism."""
        self._follows = self._follows and self.lock_mode and self._tracker.beam_locked(now_s)
        return LockStatus.LOCKED if self._follows else LockStatus.NONE

    def direction_rad(self, now_s: float) -> tuple[float, float]:
        """Hz within a turn, and V."""
        azimuth_rad, v_rad = self._tracker.direction(now_s)
        return (0.5 * math.pi - azimuth_rad + self.orientation_rad) % math.tau, v_rad

    def turn(
        self, hz_rad: float, v_rad: float, now_s: float, *, to_target: bool
    ) -> Outcome | Later:
        """Turn there, and if asked for, onto the prism in view."""
        if max(abs(hz_rad), abs(v_rad)) > math.tau:
            return refusal(Result.INVALID_PARAMETER)
        if to_target and not self.recognition:
            return refusal(Result.AUT_NOT_ENABLED)
        here_hz, here_v = self.direction_rad(now_s)
        turns_rad = (abs(math.remainder(hz_rad - here_hz, math.tau)), abs(v_rad - here_v))
        there_mm = self._point_mm(hz_rad - self.orientation_rad, v_rad, now_s)
        self._let_go()
        due_s = now_s + max(turns_rad) / SLEW_RAD_PER_S + (AIM_S if to_target else 0.0)
        return Later(due_s, lambda end_s: self._arrive(there_mm, end_s, to_target=to_target))

    def search(self, window_rad: float, now_s: float, *, takes_s: float) -> Outcome | Later:
        """Aim at the prism within a window around the present direction."""
        if not self.recognition:
            return refusal(Result.AUT_NOT_ENABLED)
        here_mm = self._tracker.beam.point_in_tracker_mm(now_s)
        found = self._tracker.beam.candidate(_aim(here_mm, window_rad), now_s) is not None
        self._let_go()
        due_s = now_s + (takes_s if found else self._tracker.search_timeout_s)
        return Later(due_s, lambda end_s: self._seek(here_mm, window_rad, end_s))

    def lock_in(self, now_s: float) -> Outcome | Later:
        """Follow the prism that it is aimed at."""
        if not self.lock_mode:
            return refusal(Result.AUT_NOT_ENABLED)
        return Later(now_s + LOCK_S, self._lock)

    def _lock(self, now_s: float) -> Outcome:
        self._follows = self._tracker.beam_locked(now_s)
        return DONE if self._follows else refusal(Result.AUT_NO_TARGET)

    def _arrive(self, there_mm: Array, now_s: float, *, to_target: bool) -> Outcome:
        if to_target:
            return self._seek(there_mm, FIELD_RAD, now_s)
        self._tracker.beam.search(_aim(there_mm, 0.0), now_s)
        self._tracker.beam.release()
        return DONE

    def _seek(self, there_mm: Array, window_rad: float, now_s: float) -> Outcome:
        found = self._tracker.beam.search(_aim(there_mm, window_rad), now_s)
        return DONE if found else refusal(Result.AUT_NO_TARGET)

    def _let_go(self) -> None:
        self._follows = False
        self._tracker.beam.release()

    def _point_mm(self, hz_rad: float, v_rad: float, now_s: float) -> Array:
        """(3,): in a direction, as far away as what it looks at now."""
        far_mm = float(np.linalg.norm(self._tracker.beam.point_in_tracker_mm(now_s)))
        across = math.sin(v_rad)
        axes = [across * math.sin(hz_rad), across * math.cos(hz_rad), math.cos(v_rad)]
        point_mm: Array = far_mm * np.array(axes)
        return point_mm


def _aim(there_mm: Array, window_rad: float) -> Aim:
    """A search in a window, whatever the distance."""
    x, y, z = map(float, there_mm)
    radius_mm = math.tan(0.5 * window_rad) * float(np.linalg.norm(there_mm))
    return Aim((x, y, z), radius_mm, any_distance=True)
