"""The robot's and the controller's part of a scenario. Every default means "ideal"."""

from collections.abc import Mapping
from typing import Annotated, Self

from pydantic import AfterValidator, Field, model_validator

from sim.geometry import ARM_FIELDS, ARMS, FLAT_NAMES, NOMINAL_ROBOTS, problem_with
from sim.scenarios.section import NotNegative, PerArm, Point, Positive, Section, nearest

NOWHERE: PerArm = (0.0, 0.0, 0.0, 0.0)


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
    """Parameters of one arm, as in a robot file."""

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
        """Values by their flat names, mm and deg."""
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
    """Repeatability: what differs at each arrival."""

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

    @model_validator(mode="after")
    def _faces_somewhere(self) -> Self:
        if self.facing is not None and not any(self.facing):
            raise ValueError("facing is 0, 0, 0; give a direction")
        return self


class RobotSection(Section):
    """The true robot: a nominal one, errors on it, and what its model does not know."""

    nominal: str | None = None
    geometry: GeometrySection | None = None
    errors: FlatDeltas = Field(default_factory=dict)
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
    geometry_errors: FlatDeltas = Field(default_factory=dict)
    joint_limits_deg: tuple[float, float] = (-45.0, 90.0)
    joint_speed_deg_per_s: Positive = 180.0
    encoder_step_deg: Positive = 1e-6
    emergency_stop: bool = False
    joints_from: str | None = None
    """A real controller whose joints the robot follows: hal:, hal:ssh HOST, tcp://HOST:PORT."""
    start: Pose = Pose()

    @model_validator(mode="after")
    def _limits_are_in_order(self) -> Self:
        if self.joint_limits_deg[0] >= self.joint_limits_deg[1]:
            raise ValueError("joint_limits_deg: the lowest must be below the highest")
        return self
