"""Monitors of a run: the air, and where the tracker stands.

They announce and never end a run: neither spoils a shot by itself.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from math import dist, hypot

import numpy as np

from campaigns.fit.rigid_transforms import fit_transform
from campaigns.journal.records import Event, Outcome
from campaigns.kinematics.model import Kinematics
from campaigns.measuring.stopping_rule import in_ranges
from campaigns.planning.plan_check import view_fault
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import View
from campaigns.robots.robot import pose_row
from drivers.values import Vector3, Weather, vector

ALARM_ENDS_AT = 0.8
"""Share of the limit below which an alarm ends, lest noise at the limit repeats it."""
NOMINAL_STD_MM = 3.0
"""Least error of a nominal robot's positions, by which the fitted place is uncertain."""
PLACE_LIMIT_MM = 100.0
"""Largest error of a place in campaign.yaml that is taken for right."""
LIMIT_SIGMAS = 3.0
WRONG_PLACE = "the tracker stands at"
"""Beginning of the event that names the fitted place."""


class TemperatureMonitor:
    """Watches the air's temperature, and announces when an alarm begins and when it ends."""

    def __init__(self, limit_degC: float, first: Weather | None) -> None:
        self._limit_degC = limit_degC
        self._first = first
        self._alarmed = False

    def events(self, weather: Weather | None) -> tuple[Event, ...]:
        """Return the event of an alarm that begins or ends with this shot's air, if one does."""
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


@dataclass(frozen=True, slots=True)
class Station:
    """The tracker's place and the reflector's direction as campaign.yaml has them; base frame."""

    place_mm: Vector3
    facing: Vector3 | None
    """None: the reflector faces the tracker from the workspace's centre."""
    acceptance_rad: float
    centre_mm: Vector3

    def seen_from(self, place_mm: Vector3) -> View:
        """Return the view of the reflector from another place."""
        away = np.subtract(place_mm, self.centre_mm)
        return View(place_mm, self.facing or vector(away), self.acceptance_rad)


class StationMonitor:
    """Monitor of the place in campaign.yaml against what the first shots of a session show."""

    def __init__(
        self, station: Station | None, kinematics: Kinematics, planned: Sequence[PlannedShot]
    ) -> None:
        """Watch a place; `station` is None if campaign.yaml gives none."""
        self._station = station
        self._kinematics = kinematics
        self._planned = planned

    def events(self, accepted: Sequence[Outcome]) -> tuple[Event, ...]:
        """Return the events that follow from the shots that count so far; each only once."""
        return tuple(self._compare(self._station, accepted)) if self._station and accepted else ()

    def _compare(self, station: Station, accepted: Sequence[Outcome]) -> Iterator[Event]:
        fitted = fit_place(self._kinematics, accepted)
        if fitted is None:
            return
        place_mm, std_mm = fitted
        off_mm = dist(place_mm, station.place_mm)
        # The first shots place the tracker roughly: the limit then is that of the fit. Once the
        # place is wrong for certain, or the fit good enough to confirm it, the question is closed.
        limit_mm = max(PLACE_LIMIT_MM, LIMIT_SIGMAS * std_mm)
        if off_mm > limit_mm or limit_mm == PLACE_LIMIT_MM:
            self._station = None
        if off_mm > limit_mm:
            yield Event(
                "tracker place",
                f"{WRONG_PLACE} {_place_text(place_mm)} mm, campaign.yaml says "
                f"{_place_text(station.place_mm)}: {off_mm / 1000.0:.1f} m off; "
                "correct tracker.place_mm",
            )
            yield from self._name_unseen_shots(station, place_mm)

    def _name_unseen_shots(self, station: Station, place_mm: Vector3) -> Iterator[Event]:
        view, mechanism = station.seen_from(place_mm), self._kinematics.mechanism
        unseen = sorted(
            shot.shot for shot in self._planned if view_fault(pose_row(shot.pose), view, mechanism)
        )
        if unseen:
            yield Event(
                "tracker place",
                f"from there {len(unseen)} of {len(self._planned)} shots of the plan cannot be "
                f"seen, their reflector being turned away: {in_ranges(unseen)}; move the tracker, "
                "or correct tracker.place_mm and make a new plan",
            )


def fit_place(kinematics: Kinematics, accepted: Sequence[Outcome]) -> tuple[Vector3, float] | None:
    """Fit the tracker's place in the base frame; return it and its standard deviation, mm.

    None while the shots determine no frame.
    """
    # The nominal robot's positions are fitted rigidly onto the points; the origin of the tracker's
    # frame is the place. Its σ has two parts: that of the mean point, σ/√n, and that of the
    # rotation times the distance to the tracker. The rotation about the points' main direction is
    # the least certain; its lever is their extent across that direction, the second singular value
    # (root of a sum over the points, so that it grows with √n).
    modelled = kinematics.forward(np.array([outcome.joints for outcome in accepted]))
    positions_mm = kinematics.points(modelled.values[modelled.is_solved])
    points_mm = np.array([outcome.point_in_tracker_mm for outcome in accepted])[modelled.is_solved]
    if len(points_mm) < 4:
        return None
    extents_mm = np.linalg.svd(positions_mm - positions_mm.mean(axis=0), compute_uv=False)
    if not extents_mm[1] > NOMINAL_STD_MM:
        return None
    tracker_from_base = fit_transform(positions_mm, points_mm)
    place_mm = tracker_from_base.inverted().translation_mm
    residual_mm = points_mm - tracker_from_base.apply(positions_mm)
    std_mm = max(NOMINAL_STD_MM, float(np.sqrt(np.mean(residual_mm**2))))
    away_mm = float(np.linalg.norm(place_mm - positions_mm.mean(axis=0)))
    std_mm *= hypot(len(points_mm) ** -0.5, away_mm / float(extents_mm[1]))
    return vector(place_mm), std_mm


def _place_text(place_mm: Vector3) -> str:
    return f"({', '.join(f'{value:.0f}' for value in place_mm)})"
