"""What a scenario file (`pkmcal/cell/1`) may say. Every key has a default that means "ideal"."""

import difflib
from collections.abc import Iterable, Mapping
from typing import Annotated, ClassVar, Literal, Self

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, model_validator

from sim.faults import ANSWER_FAULTS, MEASUREMENT_FAULTS, MOVE_FAULTS
from sim.geometry import ARM_FIELDS, ARMS, FLAT_NAMES, NOMINAL_ROBOTS, problem_with

Positive = Annotated[float, Field(gt=0.0)]
NotNegative = Annotated[float, Field(ge=0.0)]
Count = Annotated[int, Field(ge=1)]
PerArm = tuple[float, float, float, float]
Point = tuple[float, float, float]
NOWHERE: PerArm = (0.0, 0.0, 0.0, 0.0)


def nearest(unknown: str, known: Iterable[str]) -> str:
    """A remedy for a word that is not known: the nearest one that is, or all of them."""
    words = list(known)
    close = difflib.get_close_matches(unknown, words, n=1)
    return f"did you mean {close[0]}?" if close else f"known here: {', '.join(words)}"


class Section(BaseModel):
    """Nothing unknown, nothing converted, no NaN; fixed once read."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


def _only_parameters(deltas: dict[str, float]) -> dict[str, float]:
    for name in deltas:
        if name not in FLAT_NAMES:
            raise ValueError(f"{name} is no parameter; {nearest(name, FLAT_NAMES)}")
    return deltas


FlatDeltas = Annotated[dict[str, float], AfterValidator(_only_parameters)]
"""Differences of single parameters, by flat name, in the name's unit."""


def changed(flat: Mapping[str, float], deltas: Mapping[str, float]) -> dict[str, float]:
    """The parameters with these differences."""
    return {name: flat[name] + deltas.get(name, 0.0) for name in FLAT_NAMES}


class ArmSection(Section):
    """One arm, as in a robot file."""

    x_mm: float
    y_mm: float
    z_mm: float
    azimuth_deg: float
    joint_offset_deg: float
    arm_mm: Positive
    forearm_mm: Positive


class GeometrySection(Section):
    """A robot's parameters, as in a robot file."""

    arms: tuple[ArmSection, ArmSection, ArmSection, ArmSection]
    plate_mm: Positive

    def flat(self) -> dict[str, float]:
        """By their flat names, mm and deg."""
        flat = {
            f"arm{arm}.{field}": float(getattr(self.arms[arm], field))
            for arm in range(ARMS)
            for field in ARM_FIELDS
        }
        return {**flat, "plate_mm": self.plate_mm}


class Tolerances(Section):
    """Standard deviations of manufacture, drawn by the seed; the first motor holds the frame."""

    position_mm: NotNegative = 0.0
    length_mm: NotNegative = 0.0
    joint_offset_deg: NotNegative = 0.0
    azimuth_mrad: NotNegative = 0.0
    rod_mm: NotNegative = 0.0
    axis_tilt_mrad: NotNegative = 0.0


class Repeatability(Section):
    """What differs at each arrival."""

    joint_arcsec: NotNegative = 0.0
    """Standard deviation of each joint."""
    position_mm: NotNegative = 0.0
    """Half-width of a uniform draw on each coordinate."""


class ThermalSection(Section):
    """Arms that grow with worked time."""

    arm_ppm_per_degC: float = 12.0
    rise_degC: float = 0.0
    time_constant_s: Positive = 1800.0


class MountSection(Section):
    """The reflector on the plate. It faces the tracker from the workspace's centre unless told."""

    offset_mm: Point = (20.0, -30.0, -45.0)
    facing: Point | None = None


class RobotSection(Section):
    """The true robot: a nominal one, errors on it, and what its model does not know."""

    nominal: str | None = None
    geometry: GeometrySection | None = None
    errors: FlatDeltas = {}
    tolerances: Tolerances = Tolerances()
    rod_errors_mm: tuple[float, float, float, float, float, float, float, float] = (0.0,) * 8
    axis_tilts_mrad: PerArm = NOWHERE
    backlash_arcmin: tuple[NotNegative, NotNegative, NotNegative, NotNegative] = NOWHERE
    repeatability: Repeatability = Repeatability()
    thermal: ThermalSection = ThermalSection()
    plate_joints_mm: tuple[Point, Point, Point, Point] = (
        (-60.0, 0.0, 0.0),
        (60.0, 0.0, 0.0),
        (60.0, 0.0, 0.0),
        (-60.0, 0.0, 0.0),
    )
    rod_spacing_mm: Positive = 80.0
    reflector: MountSection = MountSection()

    @model_validator(mode="after")
    def _is_a_robot(self) -> Self:
        if (self.nominal is None) == (self.geometry is None):
            raise ValueError("give either nominal (a name) or geometry (arms and plate_mm)")
        if self.nominal is not None and self.nominal not in NOMINAL_ROBOTS:
            hint = nearest(self.nominal, NOMINAL_ROBOTS)
            raise ValueError(f"nominal '{self.nominal}' is not known; {hint}")
        if problem := problem_with(self.true_flat()):
            raise ValueError(f"with its errors, {problem}")
        return self

    def nominal_flat(self) -> dict[str, float]:
        """The robot as it was meant to be."""
        if self.geometry is not None:
            return self.geometry.flat()
        return dict(NOMINAL_ROBOTS[str(self.nominal)])

    def true_flat(self) -> dict[str, float]:
        """The robot with its errors, before tolerances are drawn."""
        return changed(self.nominal_flat(), self.errors)


class Pose(Section):
    """A pose of the controlled point."""

    x_mm: float = 0.0
    y_mm: float = 0.0
    z_mm: float = -575.0
    theta_deg: float = 0.0


class ControllerSection(Section):
    """The controller. Its geometry is the nominal robot's unless it has errors of its own."""

    serial: str = "SIM-C-0001"
    geometry_errors: FlatDeltas = {}
    joint_limits_deg: tuple[float, float] = (-45.0, 90.0)
    joint_speed_deg_per_s: Positive = 180.0
    encoder_step_deg: Positive = 1e-6
    emergency_stop: bool = False
    start: Pose = Pose()

    @model_validator(mode="after")
    def _limits_are_in_order(self) -> Self:
        if self.joint_limits_deg[0] >= self.joint_limits_deg[1]:
            raise ValueError("joint_limits_deg: the lowest must be below the highest")
        return self


class LimitSection(Section):
    """A maximum permissible error; its standard uncertainty is 1/√3 of it."""

    constant_um: NotNegative
    per_metre_um: NotNegative


class NoiseSection(Section):
    """Either the same on all coordinates, or of a spherical instrument."""

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


class StationSection(Section):
    """Where the tracker stands in the base frame; turned by roll, then pitch, then yaw."""

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


class FaultSection(Section):
    """One fault: exactly one of at_measurement, at_move, or at_answer with its device."""

    KINDS: ClassVar[dict[str, tuple[str, ...]]] = {
        "at_measurement": MEASUREMENT_FAULTS,
        "at_move": MOVE_FAULTS,
        "at_answer": ANSWER_FAULTS,
    }

    at_measurement: Count | None = None
    at_move: Count | None = None
    at_answer: Count | None = None
    device: Literal["controller", "tracker"] | None = None
    kind: str
    seconds: NotNegative | None = None
    """How long it lasts, or how late the answer is; without it, for good."""

    @property
    def counter(self) -> str:
        """The key that says when."""
        return next(key for key in self.KINDS if getattr(self, key) is not None)

    @model_validator(mode="after")
    def _is_one_fault(self) -> Self:
        if sum(getattr(self, key) is not None for key in self.KINDS) != 1:
            raise ValueError(f"give exactly one of {', '.join(self.KINDS)}")
        if (self.device is not None) != (self.at_answer is not None):
            raise ValueError("device goes with at_answer, and at_answer with device")
        kinds = self.KINDS[self.counter]
        if self.kind not in kinds:
            raise ValueError(f"kind {self.kind} with {self.counter}; {nearest(self.kind, kinds)}")
        return self


class Scenario(Section):
    """A simulated cell."""

    name: Annotated[str, Field(min_length=1)]
    about: str = ""
    seed: Annotated[int, Field(ge=0)] = 1
    speed_up: Annotated[float, Field(gt=0.0, le=10_000.0)] = 100.0
    robot: RobotSection
    controller: ControllerSection = ControllerSection()
    tracker: TrackerSection
    faults: tuple[FaultSection, ...] = ()

    def controller_flat(self) -> dict[str, float]:
        """The geometry that the controller is delivered with."""
        return changed(self.robot.nominal_flat(), self.controller.geometry_errors)

    @model_validator(mode="after")
    def _parts_fit(self) -> Self:
        if problem := problem_with(self.controller_flat()):
            raise ValueError(f"the controller's geometry: {problem}")
        wrong = any(fault.kind == "wrong_target" for fault in self.faults)
        if wrong and self.tracker.other_reflector_mm is None:
            raise ValueError("a wrong_target needs tracker.other_reflector_mm")
        places = [(f.counter, f.device, getattr(f, f.counter)) for f in self.faults]
        if len(set(places)) < len(places):
            raise ValueError("two faults are at the same place")
        return self
