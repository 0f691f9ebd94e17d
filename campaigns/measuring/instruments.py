"""Instruments: what a person, or the simulated cell, is asked to read while the robot stands."""

from collections.abc import Callable
from dataclasses import dataclass

from drivers.values import NoValue


@dataclass(frozen=True, slots=True)
class Task:
    """What an instrument is read for, the robot standing still."""

    kind: str
    """Word of `campaigns.fit.kinds.KINDS`."""
    object: str
    columns: tuple[str, ...]
    """Values wanted, as columns of observations.csv with their units; () at a pose to mark."""
    pose: int
    """Number of the pose, from 1."""
    poses: int
    """Number of poses of the observation."""
    place: str
    """Pose of the robot by its nominal parameters, in words."""
    std_mm: float
    """1 σ of a value, as planned."""

    @property
    def question(self) -> str:
        """Return the task in words."""
        at = f"at {self.place}"
        if not self.columns:
            return f"{self.kind} of {self.object}, pose {self.pose} of {self.poses}, {at}: mark it"
        return f"{self.kind} of {self.object} {at}: {' '.join(self.columns)}"


Answer = tuple[float, ...] | NoValue
"""Values in the units of the task's columns; () where a place was marked."""
Instrument = Callable[[Task], Answer]
