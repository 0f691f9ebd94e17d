"""Motions of the simulated axes in time: all joints together along a straight joint path."""

from collections.abc import Callable
from dataclasses import dataclass

from sim.geometry import Array

PEAK_OF_SMOOTH = 1.875
"""Highest speed of the smooth profile, as a multiple of its mean."""
SHORTEST_S = 0.05
BRAKING_S = 0.05

Profile = Callable[[float], float]


def smooth(part_of_time: float) -> float:
    """Travelled part at a part of the time: starts and ends without speed or acceleration."""
    t = part_of_time
    return t * t * t * (10.0 - t * (15.0 - 6.0 * t))


def braking(part_of_time: float) -> float:
    """Travelled part at a part of the time: from full speed to rest at constant deceleration."""
    return part_of_time * (2.0 - part_of_time)


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """One motion of all joints from rest or speed to rest."""

    start_rad: Array
    target_rad: Array
    start_s: float
    duration_s: float
    profile: Profile

    @property
    def end_s(self) -> float:
        """When it is over."""
        return self.start_s + self.duration_s

    def joints_rad(self, now_s: float) -> Array:
        """(4,): where the joints are."""
        part = (now_s - self.start_s) / self.duration_s
        travelled = self.profile(min(max(part, 0.0), 1.0))
        return self.start_rad + travelled * (self.target_rad - self.start_rad)


def smooth_motion(
    start_rad: Array, target_rad: Array, speed_rad_per_s: float, now_s: float
) -> Motion:
    """A motion whose fastest joint just reaches that speed."""
    longest_rad = float(abs(target_rad - start_rad).max())
    duration_s = max(PEAK_OF_SMOOTH * longest_rad / speed_rad_per_s, SHORTEST_S)
    return Motion(start_rad, target_rad, now_s, duration_s, smooth)


def braked(motion: Motion, now_s: float) -> Motion:
    """The same motion stopped at once, on its own path; unchanged when it is as good as over."""
    left_s = motion.end_s - now_s
    if left_s < 1.5 * BRAKING_S:
        return motion
    here_rad = motion.joints_rad(now_s)
    glimpse_s = 1e-3 * BRAKING_S
    ahead_rad = motion.joints_rad(now_s + glimpse_s) - here_rad
    target_rad = here_rad + ahead_rad * (0.5 * BRAKING_S / glimpse_s)
    return Motion(here_rad, target_rad, now_s, BRAKING_S, braking)
