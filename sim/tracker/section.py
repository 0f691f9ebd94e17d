"""The tracker's part of a scenario: its station, its noise, the air, and its reflectors.

The stand may creep and the air may grow warmer with worked time (sim/random_streams.py); both are
then known only to the cell, and a campaign has to notice.
"""

from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from sim.robot.rods import rotation
from sim.section import Count, NotNegative, Point, Positive, Section
from sim.tracker.optics import Noise, TrackerPose

S_PER_H = 3600.0


class StationSection(Section):
    """Pose of the tracker in the base frame, turned by roll, then pitch, then yaw."""

    x_mm: float
    y_mm: float
    z_mm: float
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0
    creep_mm_per_h: Point = (0.0, 0.0, 0.0)
    """Drift of the stand in the base frame, with worked time."""
    yaw_deg_per_h: float = 0.0
    """Turn of the stand, with worked time."""

    def pose(self, worked_s: float = 0.0) -> TrackerPose:
        """Return the pose after a time of work."""
        # roll, pitch and yaw turn about fixed axes in this order, as `rotation` has them
        hours = worked_s / S_PER_H
        yaw_deg = self.yaw_deg + hours * self.yaw_deg_per_h
        turns_rad = np.radians([self.roll_deg, self.pitch_deg, yaw_deg])
        origin_mm = np.array([self.x_mm, self.y_mm, self.z_mm])
        return TrackerPose(origin_mm + hours * np.array(self.creep_mm_per_h), rotation(*turns_rad))


class Air(Section):
    """Weather at the start, and its drift with worked time."""

    temperature_degC: float = 20.0
    pressure_hPa: float = 1013.25
    humidity_percent: Annotated[float, Field(ge=0.0, le=100.0)] = 50.0
    drift_degC_per_h: float = 0.0


class SimulatedReflector(Section):
    """A reflector definition that the tracker holds. Target type 1 is a corner cube."""

    id: Count
    name: Annotated[str, Field(min_length=1, max_length=31)]
    target_type: Annotated[int, Field(ge=0, le=11)] = 1
    surface_offset_mm: NotNegative


class NestSection(Section):
    """A reflector that stands fixed in a nest, in the base frame."""

    name: Annotated[str, Field(min_length=1)]
    """Name of the nest; `new` writes it into campaign.yaml."""
    place_mm: Point
    """Place of its reflector in the base frame."""


class TrackerSection(Section):
    """Tracker as it is delivered, and the state in which it is found."""

    serial: Annotated[str, Field(pattern="^[0-9]{1,9}$")] = "390001"
    """Serial number, up to nine digits."""
    station: StationSection = StationSection(x_mm=1930.0, y_mm=-1480.0, z_mm=-260.0, yaw_deg=137.0)
    noise: Noise = Noise(coordinate_mm=0.01)
    """Scatter of points; the default is `coordinate_mm` 0.01, since no driver takes points
    without uncertainty.
    """
    air: Air = Air()
    initialise_s: NotNegative = 20.0
    """Duration of an initialisation."""
    warm_up_s: NotNegative = 0.0
    """Warm-up time from the cell's start; 0: it is warm."""
    initialised: bool = True
    """Whether it is initialised at the start."""
    beam_locked: bool = True
    """Whether the beam is on the reflector at the start."""
    acceptance_deg: Positive = 30.0
    """Largest angle of the beam at which the reflector is seen."""
    reflectors: tuple[SimulatedReflector, ...] = (
        SimulatedReflector(id=1, name="CCR-1.5in", surface_offset_mm=19.05),
        SimulatedReflector(id=3, name="CCR-75mm", surface_offset_mm=37.5),
    )
    """Reflectors that it knows; default: CCR-1.5in and CCR-75mm."""
    selected: Count = 1
    """Number of the reflector in use."""
    other_reflector_mm: Point | None = None
    """Second reflector that stands about, in the base frame."""
    nests: tuple[NestSection, ...] = ()
    """Reflectors that stand fixed."""
    scale_ppm: float = 0.0
    """Scale error of its distance meter."""

    @model_validator(mode="after")
    def _reflectors_are_told_apart(self) -> Self:
        identifiers = [reflector.id for reflector in self.reflectors]
        if len(set(identifiers)) < len(identifiers):
            raise ValueError("two reflectors have the same id")
        if self.selected not in identifiers:
            raise ValueError(f"selected is {self.selected}, the reflectors are {identifiers}")
        names = [nest.name for nest in self.nests]
        if len(set(names)) < len(names):
            raise ValueError("two nests have the same name")
        return self
