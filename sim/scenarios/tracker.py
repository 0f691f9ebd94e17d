"""The tracker's part of a scenario."""

from typing import Annotated, NamedTuple, Self

from pydantic import Field, model_validator

from sim.scenarios.section import Count, NotNegative, Point, Positive, Section
from sim.tracker.optics import MPE_PER_SIGMA, UM_PER_MM


class LimitSection(Section):
    """A maximum permissible error; its standard uncertainty is 1/√3 of it."""

    constant_um: NotNegative
    per_metre_um: NotNegative


class DataSheet(NamedTuple):
    """Limits (MPE) by a data sheet of such a tracker: a constant and a part per metre."""

    along_um: float
    along_um_per_m: float
    across_um: float
    across_um_per_m: float


class NoiseSection(Section):
    """Noise, either the same on all coordinates, or of a spherical instrument."""

    coordinate_mm: Positive | None = None
    along: LimitSection | None = None
    azimuth: LimitSection | None = None
    elevation: LimitSection | None = None

    @model_validator(mode="after")
    def _is_one_of_two(self) -> Self:
        spherical = [limit is not None for limit in (self.along, self.azimuth, self.elevation)]
        if any(spherical) == (self.coordinate_mm is not None) or any(spherical) != all(spherical):
            raise ValueError("give either coordinate_mm, or along, azimuth and elevation")
        return self

    @property
    def data_sheet(self) -> DataSheet:
        """Across the beam the larger of azimuth's and elevation's."""
        if self.along is None or self.azimuth is None or self.elevation is None:
            limit_um = (self.coordinate_mm or 0.0) * UM_PER_MM * MPE_PER_SIGMA
            return DataSheet(limit_um, 0.0, limit_um, 0.0)
        across = (self.azimuth, self.elevation)
        return DataSheet(
            self.along.constant_um,
            self.along.per_metre_um,
            max(limit.constant_um for limit in across),
            max(limit.per_metre_um for limit in across),
        )


class StationSection(Section):
    """Pose of the tracker in the base frame, turned by roll, then pitch, then yaw."""

    x_mm: float
    y_mm: float
    z_mm: float
    yaw_deg: float = 0.0
    pitch_deg: float = 0.0
    roll_deg: float = 0.0


class AirSection(Section):
    """Weather, and its drift with worked time."""

    temperature_degC: float = 20.0
    pressure_hPa: float = 1013.25
    humidity_percent: Annotated[float, Field(ge=0.0, le=100.0)] = 50.0
    drift_degC_per_h: float = 0.0


class ReflectorSection(Section):
    """A reflector definition that the tracker holds. Target type 1 is a corner cube."""

    id: Count
    name: Annotated[str, Field(min_length=1, max_length=31)]
    target_type: Annotated[int, Field(ge=0, le=11)] = 1
    surface_offset_mm: NotNegative


class TrackerSection(Section):
    """The tracker."""

    serial: Annotated[str, Field(pattern="^[0-9]{1,9}$")] = "390001"
    station: StationSection
    noise: NoiseSection
    air: AirSection = AirSection()
    initialise_s: NotNegative = 20.0
    warm_up_s: NotNegative = 0.0
    initialised: bool = True
    beam_locked: bool = True
    acceptance_deg: Positive = 30.0
    reflectors: tuple[ReflectorSection, ...] = (
        ReflectorSection(id=1, name="CCR-1.5in", surface_offset_mm=19.05),
        ReflectorSection(id=3, name="CCR-75mm", surface_offset_mm=37.5),
    )
    selected: Count = 1
    other_reflector_mm: Point | None = None
    """A second reflector that stands about, in the base frame."""

    @model_validator(mode="after")
    def _reflectors_are_told_apart(self) -> Self:
        identifiers = [reflector.id for reflector in self.reflectors]
        if len(set(identifiers)) < len(identifiers):
            raise ValueError("two reflectors have the same id")
        if self.selected not in identifiers:
            raise ValueError(f"selected is {self.selected}, the reflectors are {identifiers}")
        return self
