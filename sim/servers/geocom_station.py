"""A simulated total station on a tracker's beam: its telescope and its distance meter."""

import math
from collections.abc import Callable, Sequence
from functools import partial
from math import cos, sin

import numpy as np

from drivers.values import Vector3
from drivers.wire.geocom import parse_number, parse_whole, parse_words
from drivers.wire.geocom_constants import LockStatus, Program, Result, Rpc
from sim.geometry import Array
from sim.servers.geocom_instrument import (
    DONE,
    WRONG,
    GeocomInstrument,
    GeocomOutcome,
    Handler,
    Obeyed,
    Values,
    told,
)
from sim.servers.queueing import Later
from sim.tracker.beam import Aim
from sim.tracker.instrument import SLEW_RAD_PER_S, SimulatedTracker
from sim.tracker.optics import MM_PER_M

SEARCH_S = 0.5
AIM_S = 0.5
LOCK_S = 0.2
MEASURING_S = 1.5
MS_PER_S = 1e3
NO_COORDINATES: Values = (0.0, 0.0, 0.0, 0) * 2
"""East, north, height and time in whole milliseconds, twice: sent also where there are none."""
DEFAULT_DISTANCE = 2
"""The mode of BAP_MeasDistanceAngle that measures."""
SECOND_FACE = 2
FIELD_RAD = 0.02
"""Field in which target recognition sees a prism without searching."""


class Head:
    """Direction of the telescope, and whether it follows a prism.

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
        """Angle added to every Hz."""

    def lock_status(self, now_s: float) -> LockStatus:
        """Whether it follows a prism."""
        self._follows = self._follows and self.lock_mode and self._tracker.beam_locked(now_s)
        return LockStatus.LOCKED if self._follows else LockStatus.NONE

    def direction_rad(self, now_s: float) -> tuple[float, float]:
        """Hz within a turn, and V: in the second face from the other side, beyond half a turn."""
        azimuth_rad, v_rad = self._tracker.direction(now_s)
        hz_rad = 0.5 * math.pi - azimuth_rad + self.orientation_rad
        if self._tracker.face == SECOND_FACE:
            hz_rad, v_rad = hz_rad + math.pi, math.tau - v_rad
        return hz_rad % math.tau, v_rad

    def turn(self, hz_rad: float, v_rad: float, now_s: float, *, to_target: bool) -> Obeyed:
        """Turn there, and if asked for, onto the prism in view."""
        if max(abs(hz_rad), abs(v_rad)) > math.tau:
            return WRONG
        face = SECOND_FACE if v_rad % math.tau > math.pi else 1
        if face > self._tracker.faces:
            return WRONG
        if to_target and not self.recognition:
            return GeocomOutcome(Result.AUT_NOT_ENABLED)
        here_hz, here_v = self.direction_rad(now_s)
        turns_rad = (abs(math.remainder(hz_rad - here_hz, math.tau)), abs(v_rad - here_v))
        there_mm = self._point_mm(hz_rad - self.orientation_rad, v_rad, now_s)
        self._let_go()
        due_s = now_s + max(turns_rad) / SLEW_RAD_PER_S + (AIM_S if to_target else 0.0)

        def finish(end_s: float) -> GeocomOutcome:
            self._tracker.face = face
            return self._arrive(there_mm, end_s, to_target=to_target)

        return Later(due_s, finish)

    def turn_over(self, now_s: float, *, to_target: bool) -> Obeyed:
        """Turn into the other face, to where it looks now, and if asked for, onto the prism."""
        if to_target and not self.recognition:
            return GeocomOutcome(Result.AUT_NOT_ENABLED)
        there_mm = self._tracker.beam.point_in_tracker_mm(now_s)
        turn_s = self._tracker.change_face(now_s)
        if turn_s is None:
            return GeocomOutcome(Result.NOT_IMPLEMENTED)
        self._let_go()
        due_s = now_s + turn_s + (AIM_S if to_target else 0.0)
        return Later(due_s, lambda end_s: self._arrive(there_mm, end_s, to_target=to_target))

    def search(self, window_rad: float, now_s: float, *, takes_s: float) -> Obeyed:
        """Aim at the prism within a window around the present direction."""
        if not self.recognition:
            return GeocomOutcome(Result.AUT_NOT_ENABLED)
        here_mm = self._tracker.beam.point_in_tracker_mm(now_s)
        found = self._tracker.beam.candidate(_aim(here_mm, window_rad), now_s) is not None
        self._let_go()
        due_s = now_s + (takes_s if found else self._tracker.search_timeout_s)
        return Later(due_s, lambda end_s: self._seek(here_mm, window_rad, end_s))

    def lock_in(self, now_s: float) -> Obeyed:
        """Follow the prism that it is aimed at."""
        if not self.lock_mode:
            return GeocomOutcome(Result.AUT_NOT_ENABLED)
        return Later(now_s + LOCK_S, self._lock)

    def _lock(self, now_s: float) -> GeocomOutcome:
        self._follows = self._tracker.beam_locked(now_s)
        return DONE if self._follows else GeocomOutcome(Result.AUT_NO_TARGET)

    def _arrive(self, there_mm: Array, now_s: float, *, to_target: bool) -> GeocomOutcome:
        if to_target:
            return self._seek(there_mm, FIELD_RAD, now_s)
        self._tracker.beam.search(_aim(there_mm, 0.0), now_s)
        self._tracker.beam.release()
        return DONE

    def _seek(self, there_mm: Array, window_rad: float, now_s: float) -> GeocomOutcome:
        found = self._tracker.beam.search(_aim(there_mm, window_rad), now_s)
        return DONE if found else GeocomOutcome(Result.AUT_NO_TARGET)

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


class GeocomStation:
    """Instrument, whoever is connected. Every call is told the time."""

    def __init__(self, tracker: SimulatedTracker) -> None:
        self.tracker = tracker
        self.instrument = GeocomInstrument(tracker)
        self.head = Head(tracker)
        self._measures_until_s: float | None = None
        self._distance: tuple[Vector3 | None, float] | None = None
        """Point in the tracker's frame, None where it found nothing, and when."""
        self._handlers = self.instrument.handlers() | self._measuring() | self._aiming()

    def obey(self, rpc: int, words: Sequence[str], now_s: float) -> Obeyed | None:
        """Do what a call wants; None: there is no such call. Raises `WireError` for its words."""
        handler = self._handlers.get(Rpc(rpc)) if rpc in set(Rpc) else None
        return None if handler is None else handler(words, now_s)

    def advance(self, now_s: float) -> None:
        """Let happen what is due by now."""
        self.tracker.advance(now_s)
        due_s = self._measures_until_s
        if due_s is not None and now_s >= due_s:
            self._measures_until_s = None
            shot = self.tracker.finish_measurement(now_s)
            self._distance = (None if shot is None else shot.point_in_tracker_mm), due_s

    def next_due_s(self) -> float | None:
        """Time of the next thing that happens by itself."""
        times = [t for t in (self._measures_until_s, self.tracker.next_event_s()) if t is not None]
        return min(times, default=None)

    def _measuring(self) -> dict[Rpc, Handler]:
        return {
            Rpc.TMC_DO_MEASURE: self._do_measure,
            Rpc.TMC_GET_COORDINATE: partial(self._when_measured, self._delivered),
            Rpc.TMC_GET_SIMPLE_COORD: partial(self._when_measured, self._simple),
            Rpc.TMC_GET_SIMPLE_MEA: partial(self._when_measured, self._polar),
            Rpc.TMC_GET_ANGLE_5: told(self.head.direction_rad),
            Rpc.BAP_MEAS_DISTANCE_ANGLE: self._distance_and_angle,
        }

    def _aiming(self) -> dict[Rpc, Handler]:
        return {
            Rpc.AUS_SET_USER_ATR_STATE: partial(self._switch, "recognition"),
            Rpc.AUS_GET_USER_ATR_STATE: told(lambda _n: (int(self.head.recognition),)),
            Rpc.AUS_SET_USER_LOCK_STATE: partial(self._switch, "lock_mode"),
            Rpc.AUS_GET_USER_LOCK_STATE: told(lambda _n: (int(self.head.lock_mode),)),
            Rpc.MOT_READ_LOCK_STATUS: told(lambda now_s: (int(self.head.lock_status(now_s)),)),
            Rpc.TMC_SET_ORIENTATION: self._orient,
            Rpc.AUT_MAKE_POSITIONING: self._turn,
            Rpc.AUT_CHANGE_FACE: self._turn_over,
            Rpc.AUT_SEARCH: partial(self._look, SEARCH_S),
            Rpc.AUT_FINE_ADJUST: partial(self._look, AIM_S),
            Rpc.AUT_LOCK_IN: lambda _w, now_s: self.head.lock_in(now_s),
        }

    def _do_measure(self, words: Sequence[str], now_s: float) -> GeocomOutcome:
        program, _inclination = map(parse_whole, parse_words(words, 2))
        if program not in set(Program):
            return GeocomOutcome(Result.NOT_IMPLEMENTED)
        self._measures_until_s = self._distance = None
        if program == Program.DISTANCE:
            self._begin(now_s)
        return DONE

    def _begin(self, now_s: float) -> None:
        self._measures_until_s = self.tracker.begin_measurement(MEASURING_S, now_s)
        if self._measures_until_s is None:
            self._distance = None, now_s

    def _when_measured(
        self, deliver: Callable[[float], GeocomOutcome], words: Sequence[str], now_s: float
    ) -> Obeyed:
        """Wait for the distance meter, at most as long as the call says."""
        wait_ms, _inclination = map(parse_whole, parse_words(words, 2))
        due_s = self._measures_until_s
        if due_s is None:
            return deliver(now_s)
        return Later(min(due_s, now_s + wait_ms / MS_PER_S), deliver)

    def _distance_and_angle(self, words: Sequence[str], now_s: float) -> Obeyed:
        (mode,) = map(parse_whole, parse_words(words, 1))
        if mode != DEFAULT_DISTANCE:
            return GeocomOutcome(Result.NOT_IMPLEMENTED, (0.0, 0.0, 0.0, 0))
        self._distance = None
        self._begin(now_s)

        def deliver(end_s: float) -> GeocomOutcome:
            polar = self._polar(end_s)
            return GeocomOutcome(polar.result, (*polar.values, mode))

        return Later(self._measures_until_s or now_s, deliver)

    def _delivered(self, now_s: float) -> GeocomOutcome:
        """Coordinates of the distance, and the same again as those of the present angles."""
        code, point_mm, at_s = self._found(now_s)
        if point_mm is None:
            return GeocomOutcome(code, NO_COORDINATES)
        point = (*self._surveyed_m(point_mm), round(at_s * MS_PER_S))
        return GeocomOutcome(values=(*point, *point))

    def _simple(self, now_s: float) -> GeocomOutcome:
        whole = self._delivered(now_s)
        return GeocomOutcome(whole.result, whole.values[:3])

    def _polar(self, now_s: float) -> GeocomOutcome:
        code, point_mm, _at_s = self._found(now_s)
        hz_rad, v_rad = self.head.direction_rad(now_s)
        distance_m = 0.0
        if point_mm is not None:
            distance_m = sum(value * value for value in point_mm) ** 0.5 / MM_PER_M
        return GeocomOutcome(code, (hz_rad, v_rad, distance_m))

    def _found(self, now_s: float) -> tuple[Result, Vector3 | None, float]:
        """Content of the distance meter by now."""
        self.advance(now_s)
        if self._distance is None:
            return Result.ANGLES_ONLY, None, now_s
        point_mm, at_s = self._distance
        return Result.DISTANCE_ERROR if point_mm is None else Result.OK, point_mm, at_s

    def _surveyed_m(self, point_mm: Vector3) -> Vector3:
        """East, north and height of the ground below the prism, as the instrument is set up."""
        x_m, y_m, z_m = (value / MM_PER_M for value in point_mm)
        turn_rad = self.head.orientation_rad
        east, north, up, prism_height = self.instrument.setup_m
        east = east + x_m * cos(turn_rad) + y_m * sin(turn_rad)
        north = north + y_m * cos(turn_rad) - x_m * sin(turn_rad)
        return east, north, up + z_m - prism_height

    def _switch(self, name: str, words: Sequence[str], _now_s: float) -> GeocomOutcome:
        (is_on,) = map(parse_whole, parse_words(words, 1))
        setattr(self.head, name, bool(is_on))
        return DONE

    def _orient(self, words: Sequence[str], now_s: float) -> GeocomOutcome:
        (hz_rad,) = map(parse_number, parse_words(words, 1))
        self.head.orientation_rad += hz_rad - self.head.direction_rad(now_s)[0]
        return DONE

    def _turn(self, words: Sequence[str], now_s: float) -> Obeyed:
        hz, v, _precise, to_target, _unused = parse_words(words, 5)
        return self.head.turn(
            parse_number(hz), parse_number(v), now_s, to_target=bool(parse_whole(to_target))
        )

    def _turn_over(self, words: Sequence[str], now_s: float) -> Obeyed:
        _precise, to_target, _unused = map(parse_whole, parse_words(words, 3))
        return self.head.turn_over(now_s, to_target=bool(to_target))

    def _look(self, takes_s: float, words: Sequence[str], now_s: float) -> Obeyed:
        return self.head.search(_window_rad(words), now_s, takes_s=takes_s)


def _window_rad(words: Sequence[str]) -> float:
    """The smaller side of a search window, at most a quarter turn."""
    hz, v, _unused = parse_words(words, 3)
    return max(min(parse_number(hz), parse_number(v), 1.5), 0.0)
