"""The robot's and the controller's part of a scenario. Every default means "ideal"."""

import json
import math
from collections.abc import Mapping
from functools import cache
from importlib import resources
from types import MappingProxyType
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import Field, PlainValidator, WithJsonSchema, model_validator
from ruamel.yaml import YAML

from sim.geometry import PAR4, TWINS, Array, Geometry, Kind, StatedKind, Unit, problem_with
from sim.robot.rods import Growth
from sim.section import NotNegative, Point, Positive, Section, nearest

PPM = 1e-6
PLATE_RADIUS_MM = 45.0
"""Radius of a single platform's joints, where the cell file does not give their places."""
PART_HALF_WIDTH_MM = 60.0
"""Half the distance of the two joints of one part of a platform, where the file gives none."""
ENTRIES_OF_AN_ARM: Mapping[str, int] = MappingProxyType(
    {
        "rod_errors_mm": 2,
        "plate_joints_mm": 1,
        "axis_tilts_mrad": 1,
        "backlash_arcmin": 1,
        "backlash_mm": 1,
    }
)
"""Keys of a robot that list values of each arm, and how many values of an arm."""

RATES = ("ripples_per_turn", "pitch_mm")
"""Keys of the transmission that are one number, or a list with a number of each arm."""
OF_CARRIAGES = ("_mm", "drive_n_per_um")
"""Ends of the keys that only carriages have."""


# pydantic would report a wrong value once for each of the two forms
def _check_one_or_each(value: Any) -> float | tuple[float, ...]:
    """Check a positive number, or a list of positive numbers."""
    entries = value if isinstance(value, list) else [value]
    if not all(type(entry) in {int, float} and 0.0 < entry < math.inf for entry in entries):
        raise ValueError("give a number above 0, or a list with one of each arm")
    return tuple(map(float, entries)) if isinstance(value, list) else float(entries[0])


OneOrEach = Annotated[
    float | tuple[float, ...],
    PlainValidator(_check_one_or_each),
    WithJsonSchema({"type": "number"}),
]
"""Positive number, or a list with one of each arm."""
FlatDeltas = dict[str, float]
"""Differences of single parameters, by flat name, in the name's unit."""


def changed(flat: Mapping[str, float], deltas: Mapping[str, float]) -> dict[str, float]:
    """Add differences to parameters; raises `ValueError` for an unknown name."""
    for name in deltas:
        if name not in flat:
            raise ValueError(f"{name} is no parameter; {nearest(name, flat)}")
    return {name: value + deltas.get(name, 0.0) for name, value in flat.items()}


@cache
def nominal_robot(name: str) -> tuple[str, Mapping[str, float]]:
    """Return mechanism and parameters of a shipped robot; raises `ValueError` for another name."""
    # The files are read as data and with a schema of this module: importing what reads them in
    # `campaigns` would share the names and meanings of parameters with the estimator.
    files = [f for f in resources.files("campaigns.robots").iterdir() if f.name.endswith(".yaml")]
    texts = {file.name.removesuffix(".yaml"): file.read_text(encoding="utf-8") for file in files}
    if name not in texts:
        raise ValueError(f"nominal '{name}' is not known; {nearest(name, sorted(texts))}")
    tree = YAML(typ="safe", pure=True).load(texts[name])
    geometry = GeometrySection.model_validate_json(json.dumps(tree["geometry"]))
    return tree["mechanism"], MappingProxyType(geometry.flat(TWINS[tree["mechanism"]]))


class GeometrySection(Section):
    """A robot's parameters, as in a robot file."""

    arms: tuple[dict[str, float], ...]
    """Arms, each with the keys of a robot file."""
    plate_mm: Positive | None = None
    pinion_mm: Positive | None = None
    platform: dict[str, float] = Field(default_factory=dict)
    """Parameters of no arm, of a mechanism of one's own."""

    @property
    def stated(self) -> dict[str, float]:
        """Values by flat name, in the order of the file."""
        arms = enumerate(self.arms)
        flat = {f"arm{arm}.{field}": value for arm, row in arms for field, value in row.items()}
        whole = {"plate_mm": self.plate_mm, "pinion_mm": self.pinion_mm}
        flat |= {name: value for name, value in whole.items() if value is not None}
        return flat | self.platform

    def flat(self, kind: Kind) -> dict[str, float]:
        """Return the values by flat name, mm and deg; raises `ValueError` if they are no robot."""
        flat = self.stated
        if problem := problem_with(flat, kind):
            raise ValueError(problem)
        return {name: flat[name] for name in kind.names}


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
    """Standard deviation of each crank."""
    joint_mm: NotNegative = 0.0
    """Standard deviation of each carriage."""
    position_mm: NotNegative = 0.0
    """Half-width of a uniform draw on each coordinate."""


class Warmth(Section):
    """Parts that grow warm, and longer, with worked time."""

    ppm_per_degC: float = 12.0
    rise_degC: float = 0.0
    time_constant_s: Positive = 1800.0

    def warmer_by(self, worked_s: float) -> float:
        """Return the temperature above that of the start, °C."""
        # first-order warming: the rise times 1 - exp(-t / τ), by worked time
        return self.rise_degC * -math.expm1(-worked_s / self.time_constant_s)


class Thermal(Section):
    """Arms, or the scales of rails; and forearms and frame, whose warmth is their own."""

    arm_ppm_per_degC: float = 12.0
    rise_degC: float = 0.0
    time_constant_s: Positive = 1800.0
    forearms: Warmth = Warmth()
    """Warmth of the forearms."""
    frame: Warmth = Warmth()
    """Warmth of the frame."""

    @property
    def parts(self) -> Mapping[str, Warmth]:
        """Warmth of arms, forearms and frame."""
        arms = Warmth(
            ppm_per_degC=self.arm_ppm_per_degC,
            rise_degC=self.rise_degC,
            time_constant_s=self.time_constant_s,
        )
        return {"arms": arms, "forearms": self.forearms, "frame": self.frame}

    def growth(self, worked_s: float) -> Growth:
        """Return the relative growth of the parts after a time of work."""
        parts = self.parts.items()
        return Growth(
            **{name: PPM * part.ppm_per_degC * part.warmer_by(worked_s) for name, part in parts}
        )


class TransmissionSection(Section):
    """Errors between encoders and joints; where in a turn they are is drawn by the seed."""

    eccentricity_um: NotNegative = 0.0
    """Eccentricity of the ring of each crank's encoder."""
    ring_mm: Positive = 50.0
    """Diameter of that ring."""
    ripple_arcsec: NotNegative = 0.0
    """Largest error in each turn of a crank's motor."""
    ripples_per_turn: OneOrEach = 30.0
    """Turns of the motor in a turn of the crank, or a list with those of each motor."""
    ripple_mm: NotNegative = 0.0
    """Largest error in each turn of a carriage's screw."""
    pitch_mm: OneOrEach = 10.0
    """Travel of a carriage in a turn of its screw, or a list with that of each carriage."""
    ratio_ppm: NotNegative = 0.0
    """Standard deviation of ratios or pitches."""


class WeightSection(Section):
    """Weights that gears or drives carry, which yield beyond their encoders."""

    gear_nm_per_arcmin: Positive | None = None
    """Stiffness of each crank's gear; left out: rigid."""
    drive_n_per_um: Positive | None = None
    """Stiffness of each carriage's drive; left out: rigid."""
    arm_kg: NotNegative = 1.0
    """Mass of a crank, in its middle, or of a carriage."""
    forearm_kg: NotNegative = 0.3
    """Mass of a forearm's two rods."""
    plate_kg: NotNegative = 1.0
    """Mass of the plate."""
    payload_kg: NotNegative = 0.0
    """Mass of the payload."""


class MountSection(Section):
    """The reflector on the plate; by default it faces the tracker from the workspace's centre."""

    offset_mm: Point = (20.0, -30.0, -45.0)
    """Reflector relative to the joints of its half (of half 1: B'0)."""
    facing: Point | None = None
    """Direction of the reflector; left out: to the tracker."""
    half: Literal[1, 2] | None = None
    """Half of a platform of two parts; left out: the controlled point's half."""

    @model_validator(mode="after")
    def _faces_somewhere(self) -> Self:
        if self.facing is not None and not any(self.facing):
            raise ValueError("facing is 0, 0, 0; give a direction")
        return self


class RobotSection(Section):
    """The true robot: a nominal one, errors on it, and what its model does not know."""

    mechanism: str = PAR4.name
    """Mechanism, as in a robot file."""
    nominal: str | None = None
    """Robot as designed, by the name of a shipped one; or `geometry`."""
    geometry: GeometrySection | None = None
    """Robot as designed, with the keys of a robot file."""
    joints: tuple[Unit, ...] = ()
    """Unit of each joint of a mechanism of one's own, deg or mm; others have their own."""
    turns: tuple[str, ...] = ()
    """Turns of the platform of a mechanism of one's own: none, theta, or rx, ry and rz."""
    zeros: tuple[str, ...] = ()
    """Parameters by name that are 0 by the drawing of a mechanism of one's own; they are drawn."""
    errors: FlatDeltas = Field(default_factory=dict)
    """True minus nominal value, by parameter name (`arm1.forearm_mm`)."""
    tolerances: Tolerances = Tolerances()
    """Standard deviations of manufacture."""
    rod_errors_mm: tuple[float, ...] = ()
    """Length of each rod minus its forearm's, two rods an arm."""
    axis_tilts_mrad: tuple[float, ...] = ()
    """Motor axes out of the horizontal; rails, and the bars on them, leaning aside."""
    backlash_arcmin: tuple[NotNegative, ...] = ()
    """Lost motion of each crank's gear."""
    backlash_mm: tuple[NotNegative, ...] = ()
    """Lost motion of each carriage's drive."""
    repeatability: Repeatability = Repeatability()
    thermal: Thermal = Thermal()
    transmission: TransmissionSection = TransmissionSection()
    weight: WeightSection = WeightSection()
    plate_joints_mm: tuple[Point, ...] | None = None
    """Place of each arm's rods on the plate."""
    workspace_centre_mm: Point = (0.0, 0.0, -575.0)
    """Place from which the reflector is turned to face the tracker."""
    rod_spacing_mm: Positive = 80.0
    """Distance of a forearm's two rods."""
    reflector: MountSection = MountSection()

    @model_validator(mode="after")
    def _is_a_robot(self) -> Self:
        if self.mechanism not in TWINS and not self.joints:
            hint = nearest(self.mechanism, TWINS)
            raise ValueError(f"mechanism '{self.mechanism}' is not known; {hint}")
        if (self.nominal is None) == (self.geometry is None):
            raise ValueError("give either nominal (a name) or geometry (arms and plate_mm)")
        if self.nominal is not None:
            mechanism, _ = nominal_robot(self.nominal)
            if mechanism != self.mechanism:
                raise ValueError(
                    f"nominal '{self.nominal}' is no {self.mechanism}; give mechanism: {mechanism}"
                )
        if self.geometry is not None and self.kind.arms != len(self.geometry.arms):
            raise ValueError(
                f"geometry has {len(self.geometry.arms)} arms, a {self.mechanism} has "
                f"{self.kind.arms}"
            )
        if problem := problem_with(self.true_flat(), self.kind):
            raise ValueError(f"with its errors, {problem}")
        return self

    @model_validator(mode="after")
    def _has_an_entry_for_each_arm(self) -> Self:
        for key, entries in ENTRIES_OF_AN_ARM.items():
            count = entries * self.kind.arms
            if (values := getattr(self, key)) and len(values) != count:
                raise ValueError(f"{key} has {len(values)} entries, a {self.mechanism} has {count}")
        for key in RATES:
            values = getattr(self.transmission, key)
            if isinstance(values, tuple) and len(values) != self.kind.arms:
                raise ValueError(
                    f"transmission.{key} has {len(values)} entries, a {self.mechanism} has "
                    f"{self.kind.arms}"
                )
        # a size for cranks on a robot with carriages, or the reverse, would have no effect: refused
        sizes = {
            "backlash_arcmin": any(self.backlash_arcmin),
            "backlash_mm": any(self.backlash_mm),
            "transmission.eccentricity_um": self.transmission.eccentricity_um,
            "transmission.ripple_arcsec": self.transmission.ripple_arcsec,
            "transmission.ripple_mm": self.transmission.ripple_mm,
            "weight.gear_nm_per_arcmin": self.weight.gear_nm_per_arcmin,
            "weight.drive_n_per_um": self.weight.drive_n_per_um,
        }
        for key, size in sizes.items():
            if size and key.endswith(OF_CARRIAGES) not in self.kind.is_carriage:
                raise ValueError(f"{key} is of other arms than a {self.mechanism} has")
        if self.reflector.half is not None and self.kind.turn is None:
            raise ValueError(f"reflector.half: the platform of a {self.mechanism} has no halves")
        return self

    @property
    def kind(self) -> Kind:
        """Parts of which it is built."""
        if self.mechanism in TWINS:
            return TWINS[self.mechanism]
        assert self.geometry is not None, "a shipped robot is of a known kind"
        return StatedKind(
            self.mechanism, self.joints, tuple(self.geometry.stated), self.turns, self.zeros
        )

    def places_on_plate_mm(self, geometry: Geometry) -> Array:
        """Return where each arm's bar is on the platform, (n, 3), from the model's joint there.

        The cell file's places; else on a circle (one part), or left and right (two parts).
        """
        if self.plate_joints_mm is not None:
            return np.array(self.plate_joints_mm)
        # a Delta's platform: on a circle, each joint in the direction of its arm
        if geometry.kind.turn is None:
            return PLATE_RADIUS_MM * geometry.outward
        # two parts: each arm's bar is on the side of its own motor, at ±x
        return np.sign(geometry.motors_mm) * [PART_HALF_WIDTH_MM, 0.0, 0.0]

    def nominal_flat(self) -> dict[str, float]:
        """Return the robot as it was meant to be."""
        if self.geometry is not None:
            return self.geometry.flat(self.kind)
        return dict(nominal_robot(str(self.nominal))[1])

    def true_flat(self) -> dict[str, float]:
        """Return the robot with its errors, before tolerances are drawn."""
        return changed(self.nominal_flat(), self.errors)


class StartSection(Section):
    """Pose of the controlled point at the start."""

    x_mm: float = 0.0
    y_mm: float = 0.0
    z_mm: float = -575.0
    theta_deg: float = 0.0
    rx_deg: float = 0.0
    ry_deg: float = 0.0
    rz_deg: float = 0.0
    """With `rx_deg` and `ry_deg` the rotation vector of a platform with three turns."""

    @property
    def pose(self) -> Array:
        """(6,): x, y, z in mm and the rotation vector in rad, of a platform that is one body."""
        turns_rad = np.radians([self.rx_deg, self.ry_deg, self.rz_deg + self.theta_deg])
        return np.array([self.x_mm, self.y_mm, self.z_mm, *turns_rad])


Lie = Literal["targets as encoders", "never moving"]
"""Mistake of a server: it reports where a motion leads as encoders, or that nothing moves."""


class ControllerSection(Section):
    """The controller. Its geometry is the nominal robot's unless it has errors of its own."""

    serial: str = "SIM-C-0001"
    """Serial number that it reports."""
    geometry_errors: FlatDeltas = Field(default_factory=dict)
    """Controller's parameters minus nominal, by name."""
    joint_limits_deg: tuple[float, float] = (-45.0, 90.0)
    """Joint limits of cranks."""
    joint_speed_deg_per_s: Positive = 180.0
    """Largest speed of cranks."""
    encoder_step_deg: Positive = 1e-6
    """Encoder resolution of cranks."""
    joint_limits_mm: tuple[float, float] = (-450.0, 450.0)
    """Joint limits of carriages."""
    joint_limits: tuple[tuple[float, float], ...] | None = None
    """Limits of each joint, deg or mm, where they differ."""
    joint_speed_mm_per_s: Positive = 1500.0
    """Largest speed of carriages."""
    encoder_step_mm: Positive = 1e-5
    """Encoder resolution of carriages."""
    emergency_stop: bool = False
    """Whether the emergency stop is pressed at the start."""
    computes_plate_tilt: bool = False
    """Whether its kinematics has axis tilts and skews, so that `load` gives it all parameters."""
    plate_joints_mm: tuple[Point, ...] | None = None
    """Place of each arm's rods on the plate by its drawing, as in the robot file; left out: the
    true places."""
    reflector_mm: Point = (0.0, 0.0, 0.0)
    """Reflector from the controlled point by its drawing, as in the robot file."""
    computes_transmission: bool = False
    """Whether it has what gears and encoders add to joints, with sides of approach."""
    watchdog_s: NotNegative = 0.0
    """Time without a line on robotline after which it stops a motion; 0: it has no watchdog."""
    lies: tuple[Lie, ...] = ()
    """What it reports wrongly on robotline while it moves."""
    start: StartSection = StartSection()

    def limits(self, kind: Kind) -> tuple[Array, Array]:
        """Return the least and largest value of every joint, (n,) each, rad or mm."""
        low, high = np.array(
            self.joint_limits or [getattr(self, f"joint_limits_{unit}") for unit in kind.units]
        ).T
        return kind.inner(low), kind.inner(high)

    def speed_per_s(self, kind: Kind) -> Array:
        """Return the speed of each joint, (n,), rad/s or mm/s."""
        return kind.inner([getattr(self, f"joint_speed_{unit}_per_s") for unit in kind.units])

    def encoder_step(self, kind: Kind) -> Array:
        """Return the resolution of each encoder, (n,), rad or mm."""
        return kind.inner([getattr(self, f"encoder_step_{unit}") for unit in kind.units])

    @model_validator(mode="after")
    def _limits_are_in_order(self) -> Self:
        of_each = {
            f"joint_limits of joint {n}": pair for n, pair in enumerate(self.joint_limits or ())
        }
        of_all = {key: getattr(self, key) for key in ("joint_limits_deg", "joint_limits_mm")}
        for key, (lowest, highest) in (of_all | of_each).items():
            if lowest >= highest:
                raise ValueError(f"{key}: the lowest must be below the highest")
        return self
