"""The tracker's beam: what it is locked on, when it is cut, and how it finds a reflector again.

The beam is locked on one reflector or on none, and points somewhere in either case. Reflectors are
the robot's, one that stands about (a wrong target to slip onto), and those in nests. A lock ends

- when a scripted fault cuts the beam, for some seconds in which nothing can be found either;
- when the robot stands and its reflector is turned away from the tracker by more than the
  acceptance angle. While the robot moves, the beam is taken to follow: losing it on the way is not
  simulated.

After a loss the beam points where the reflector was, until a search finds one: of those that can be
seen, the nearest to the middle of the search, within its radius. A search without a distance (an
`Aim` with `any_distance`) compares distances from the line of sight instead of from a point.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from sim.geometry import Array
from sim.random_streams import target_key
from sim.robot.controller import SimulatedController
from sim.robot.driven_robot import DrivenRobot, SeenReflector
from sim.tracker.optics import TrackerPose, angle_between_rad


class Scene:
    """The robot as the tracker sees it."""

    def __init__(self, controller: SimulatedController, robot: DrivenRobot) -> None:
        self._controller = controller
        self._robot = robot

    def robot_reflector(self, now_s: float) -> SeenReflector:
        """Return the reflector on the plate, in the base frame."""
        return self._robot.reflector(self._controller.encoders(now_s))

    def robot_is_still(self, now_s: float) -> bool:
        """Whether the robot stands."""
        return not self._controller.is_moving(now_s)

    def robot_target(self) -> tuple[int, ...]:
        """Return the key of the place where the robot rests."""
        return target_key(self._robot.standing.encoders.tolist())


class Target(StrEnum):
    """Reflector on which the beam can be; those in nests have names of their own."""

    ROBOT = "robot"
    STANDING = "standing"


@dataclass(frozen=True, slots=True)
class Aim:
    """A search: around a point, or around a direction whatever the distance."""

    point_in_tracker_mm: tuple[float, float, float]
    radius_mm: float
    any_distance: bool

    def miss_mm(self, candidate_in_tracker_mm: Array) -> float:
        """Return the distance of a candidate from the middle of the search."""
        point_mm = np.array(self.point_in_tracker_mm)
        if not self.any_distance:
            return float(np.linalg.norm(candidate_in_tracker_mm - point_mm))
        if candidate_in_tracker_mm @ point_mm <= 0.0:
            return math.inf  # behind the tracker
        length_mm = float(np.linalg.norm(point_mm))
        return float(np.linalg.norm(np.cross(candidate_in_tracker_mm, point_mm))) / length_mm


class Beam:
    """Locked on a reflector or on none, pointing somewhere in any case."""

    def __init__(
        self,
        scene: Scene,
        station: Callable[[], TrackerPose],
        *,
        standing_in_base_mm: Mapping[str, Array],
        acceptance_rad: float,
        locked_on: str | None,
    ) -> None:
        self.scene = scene
        self._station = station
        self._standing_in_base_mm = standing_in_base_mm
        self._acceptance_rad = acceptance_rad
        self._cut_from_s = math.inf
        self._cut_until_s = math.inf
        self._cut_is_new = False
        self._last_sight: tuple[SeenReflector, TrackerPose, bool] | None = None
        """Reflector and station that were last compared, and whether one saw the other."""
        self.locked_on = locked_on
        self._pointing_mm = self._place_mm(locked_on or Target.ROBOT, 0.0)

    def cut(self, from_s: float, lasts_s: float) -> None:
        """Cut the beam for a time that may lie ahead, as a person who steps into it does.

        There is one cut at a time: a new one replaces the one before.
        """
        self._cut_from_s, self._cut_until_s = from_s, from_s + lasts_s
        self._cut_is_new = True

    def next_cut_s(self) -> float | None:
        """Return the time of a cut that `is_lost` has not reported yet; None if there is none."""
        return self._cut_from_s if self._cut_is_new else None

    def confuse(self) -> None:
        """Slip onto the reflector that stands about, if there is one."""
        # without one the measurement goes on undisturbed; the schema of a scenario demands one
        if Target.STANDING in self._standing_in_base_mm:
            self.locked_on = Target.STANDING

    def put_on_robot(self) -> None:
        """Be put onto the robot's reflector by an operator who takes the beam along."""
        self.locked_on = Target.ROBOT

    def release(self) -> None:
        """Let go of the target, and point where it was last."""
        self.locked_on = None

    def is_lost(self, now_s: float) -> bool:
        """Whether the beam has just lost its target; it then points where the target was."""
        # a cut is reported once, even if it is over by now: a beam that is free again has lost its
        # target nevertheless
        was_cut = self._cut_is_new and now_s >= self._cut_from_s
        self._cut_is_new = self._cut_is_new and not was_cut
        if self.locked_on is None:
            return False
        if not was_cut and self._is_visible(self.locked_on, now_s):
            return False
        self._pointing_mm = self._place_mm(self.locked_on, now_s)
        self.locked_on = None
        return True

    def point_in_tracker_mm(self, now_s: float) -> Array:
        """Return the centre (3,) of the reflector it is on, or the place at which it points."""
        if self.locked_on is not None:
            self._pointing_mm = self._place_mm(self.locked_on, now_s)
        return self._pointing_mm

    def candidate(self, aim: Aim, now_s: float) -> str | None:
        """Return the visible reflector nearest to the aim, if one is within its radius."""
        if self._is_cut(now_s):
            return None
        misses = {
            target: aim.miss_mm(self._place_mm(target, now_s))
            for target in (Target.ROBOT, *self._standing_in_base_mm)
            if self._is_visible(target, now_s)
        }
        within = [target for target in misses if misses[target] <= aim.radius_mm]
        return min(within, key=misses.__getitem__, default=None)

    def search(self, aim: Aim, now_s: float) -> bool:
        """Lock on the reflector that the aim finds, or point there without a lock; return which."""
        self.locked_on = self.candidate(aim, now_s)
        # a client may ask for a place that is no number: the beam then stays where it points
        if np.isfinite(aim.point_in_tracker_mm).all():
            self._pointing_mm = np.array(aim.point_in_tracker_mm)
        return self.locked_on is not None

    def _place_mm(self, target: str, now_s: float) -> Array:
        """Return a reflector's centre (3,) in the tracker's frame."""
        standing_mm = self._standing_in_base_mm.get(target)
        if standing_mm is not None:
            return self._station().to_tracker_mm(standing_mm)
        return self._station().to_tracker_mm(self.scene.robot_reflector(now_s).point_mm)

    def _is_cut(self, now_s: float) -> bool:
        return self._cut_from_s <= now_s < self._cut_until_s

    def _is_visible(self, target: str, now_s: float) -> bool:
        """Return whether a target faces the tracker, as all but the robot's reflector always do."""
        if target != Target.ROBOT or not self.scene.robot_is_still(now_s):
            return True
        # Neither object is replaced as long as nothing has moved, so identity is enough. The angle
        # is asked for at every step of the cell's time.
        seen, station = self.scene.robot_reflector(now_s), self._station()
        if self._last_sight is not None:
            reflector, pose, visible = self._last_sight
            if reflector is seen and pose is station:
                return visible
        back_mm = station.origin_in_base_mm - seen.point_mm
        visible = angle_between_rad(seen.facing, back_mm) <= self._acceptance_rad
        self._last_sight = seen, station, visible
        return visible
