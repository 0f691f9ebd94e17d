"""Configuration of controllers with few parameters: LinuxCNC's own Deltas, and Klipper's.

Each text begins with what its values leave of position over the workspace, beside what the nominal
parameters and all identified ones leave.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import scipy

from campaigns.arrays import Array
from campaigns.controllers import model_reduction
from campaigns.errors import ConfigInvalid
from campaigns.estimation.rigid_transforms import Transform
from campaigns.files.csv_file import fixed_text
from campaigns.mechanisms.delta import DELTA
from campaigns.mechanisms.linear_delta import LINEAR_DELTA
from campaigns.mechanisms.mechanism import Axis
from campaigns.robots.robot import RobotFile
from campaigns.version import VERSION

DECIMALS = 6
_number = partial(fixed_text, decimals=DECIMALS)
ALTERNATIVES = (
    "`pkmcal load` or --format linuxcnc where a controller takes all parameters, `pkmcal correct` "
    "where it takes none"
)


@dataclass(frozen=True, slots=True, eq=False)
class ReducedParameters:
    """Values for a controller, with what is needed to write them."""

    robot: RobotFile
    model: model_reduction.SymmetricDelta
    found: model_reduction.ModelReduction
    workspace: model_reduction.Workspace

    def of_arms(self, kind: str) -> Array:
        """Values of a kind by arm, mm and rad."""
        return self.model.of_arms(self.found.values, kind)

    @property
    def radius_mm(self) -> float:
        """Radius of arms, less that of the plate."""
        return float(self.of_arms("radius")[0])

    @property
    def angles_deg(self) -> Array:
        """Directions of the arms about the vertical."""
        return np.asarray(np.degrees(self.model.azimuths + self.of_arms("angle")) % 360.0)

    @property
    def joint_axis(self) -> Axis:
        """Kind of the joints."""
        return self.robot.mechanism.joints[0]

    @property
    def bed_mm(self) -> float:
        """Lowest of the workspace in the controller's frame."""
        poses = self.found.kinematics.forward(self.workspace.joints, self.workspace.poses)
        return float(poses.values_or_raise()[:, 2].min())

    @property
    def endstop(self) -> float:
        """Reading at which switches are taken to be, where arms or carriages are highest."""
        low, high = self.robot.limits.joint
        return low if self.model.is_rotary else high

    @property
    def arm_of_joint(self) -> tuple[int, int, int]:
        """Arm of each joint of a controller that counts anticlockwise."""
        clockwise = np.sin(self.model.azimuths[1] - self.model.azimuths[0]) < 0.0
        return (0, 2, 1) if clockwise else (0, 1, 2)


Lines = Callable[[ReducedParameters], Iterator[str]]


@dataclass(frozen=True, slots=True)
class ControllerFormat:
    """Controller with few parameters: what it can be told, and how that is written."""

    controller: str
    mechanism: str
    file_name: str
    lines: Lines
    per_arm: bool = False
    angles_free: bool = False
    first_arm_deg: float | None = None
    """Where the controller has its first arm; None: wherever that is."""
    offsets: str = ""
    """Where joint offsets are written; a controller of which they are no own parameter."""
    keeps: tuple[str, ...] = field(default=())
    """What the reader must know besides."""


def few_parameters(
    robot: RobotFile, nominal: RobotFile, poses: Array, made: ControllerFormat
) -> tuple[ReducedParameters, dict[str, model_reduction.ResidualError]]:
    """Nearest values, and what is left of position with others and with these.

    `poses` (N, t) are all over the workspace. Raises `ConfigInvalid` for another mechanism, and
    `IdentificationRefused`.
    """
    if robot.mechanism.name != made.mechanism:
        raise ConfigInvalid(
            f"{robot.name}: a {robot.mechanism.name}, but {made.controller} is for a "
            f"{made.mechanism}",
            remedy=ALTERNATIVES,
        )
    workspace = model_reduction.Workspace.of(robot.kinematics, poses)

    def projected(
        *, offsets_free: bool
    ) -> tuple[model_reduction.SymmetricDelta, model_reduction.ModelReduction]:
        model = model_reduction.symmetric_delta(
            nominal.kinematics,
            per_arm=made.per_arm,
            angles_free=made.angles_free,
            offsets_free=offsets_free,
        )
        found = model_reduction.project(robot.mechanism, model.vector, model.start, workspace)
        return model, found

    model, found = projected(offsets_free=True)
    left = {"nominal parameters": model_reduction.left_by(nominal.kinematics, workspace)}
    if made.offsets:
        _, alone = projected(offsets_free=False)
        left[f"nearest values without {made.offsets}"] = alone.error
    left["these values"] = found.error
    return ReducedParameters(robot, model, found, workspace), left


def configuration_text(
    few: ReducedParameters,
    left: Mapping[str, model_reduction.ResidualError],
    made: ControllerFormat,
) -> str:
    """Text of the configuration with its heading."""
    heading = [
        f"{made.controller}: the values nearest to {few.robot.name}, written by pkmcal {VERSION}",
        f"sha256 of the identified geometry: {few.robot.digest()}",
        "",
        *_left_lines(left, len(few.workspace.poses)),
        "",
        *_frame_lines(few, made),
        *made.keeps,
    ]
    lines = [*(f"# {line}".rstrip() for line in heading), *made.lines(few), ""]
    return "\n".join(lines)


def _left_lines(left: Mapping[str, model_reduction.ResidualError], count: int) -> Iterator[str]:
    yield f"Left of position over the workspace ({count} poses, frame best fitted), mm:"
    for name, each in left.items():
        yield f"  {name}: mean {each.mean_mm:.4f}, max {each.max_mm:.4f}"


def _frame_lines(few: ReducedParameters, made: ControllerFormat) -> Iterator[str]:
    frame = few.found.base_from_controller
    if made.first_arm_deg is not None:
        turn = few.model.azimuths[0] - math.radians(made.first_arm_deg)
        frame = frame.after(
            Transform(
                scipy.spatial.transform.Rotation.from_euler("z", turn).as_matrix(), np.zeros(3)
            )
        )
    x, y, z = frame.translation_mm.tolist()
    turns = (
        scipy.spatial.transform.Rotation.from_matrix(frame.rotation)
        .as_euler("ZYX", degrees=True)
        .tolist()
    )
    yield f"The controller's frame, seen from the base: origin {x:.4f}, {y:.4f}, {z:.4f} mm,"
    yield "turned {:.4f} deg about z, then {:.4f} about y, then {:.4f} about x.".format(*turns)


def _rotarydeltakins(few: ReducedParameters) -> Iterator[str]:
    plate = np.array(few.robot.mechanism.plate.joints_mm)
    foot_mm = float(np.hypot(plate[:, 0], plate[:, 1]).mean())
    yield f"setp rotarydeltakins.platformradius {_number(few.radius_mm + foot_mm)}"
    yield f"setp rotarydeltakins.thighlength {_number(few.of_arms('arm')[0])}"
    yield f"setp rotarydeltakins.shinlength {_number(few.of_arms('forearm')[0])}"
    yield f"setp rotarydeltakins.footradius {_number(foot_mm)}"
    yield from _home_offsets(few)


def _lineardeltakins(few: ReducedParameters) -> Iterator[str]:
    yield f"setp lineardeltakins.R {_number(few.radius_mm)}"
    yield f"setp lineardeltakins.L {_number(few.of_arms('forearm')[0])}"
    yield from _home_offsets(few)


def _home_offsets(few: ReducedParameters) -> Iterator[str]:
    """Joint offsets as comments: they are of the INI file, which pkmcal does not write."""
    offsets, axis = few.of_arms("offset"), few.joint_axis
    for joint, arm in enumerate(few.arm_of_joint):
        value = axis.to_file(float(offsets[arm]))
        yield f"# [JOINT_{joint}]HOME_OFFSET: add {value:+.{DECIMALS}f} {axis.unit} (arm {arm})"


def _klipper_rotary(few: ReducedParameters) -> Iterator[str]:
    height_mm = -few.bed_mm
    yield "[printer]"
    yield "kinematics: rotary_delta"
    yield f"shoulder_radius: {_number(few.radius_mm)}"
    yield f"shoulder_height: {_number(height_mm)}"
    arms, forearms, offsets = (few.of_arms(kind) for kind in ("arm", "forearm", "offset"))
    for arm in range(model_reduction.ARMS):
        angle = few.endstop + float(offsets[arm])
        out_mm = few.radius_mm + float(arms[arm]) * math.cos(angle)
        elbow_mm = height_mm - float(arms[arm]) * math.sin(angle)
        yield from _stepper(few, arm)
        yield f"upper_arm_length: {_number(arms[arm])}"
        yield f"lower_arm_length: {_number(forearms[arm])}"
        drop_mm = _drop_mm(float(forearms[arm]), out_mm)
        yield f"position_endstop: {_number(elbow_mm - drop_mm)}"


def _klipper_linear(few: ReducedParameters) -> Iterator[str]:
    yield "[printer]"
    yield "kinematics: delta"
    yield f"delta_radius: {_number(few.radius_mm)}"
    forearms, offsets = few.of_arms("forearm"), few.of_arms("offset")
    for arm in range(model_reduction.ARMS):
        carriage_mm = few.endstop + float(offsets[arm]) - few.bed_mm
        yield from _stepper(few, arm)
        yield f"arm_length: {_number(forearms[arm])}"
        drop_mm = _drop_mm(float(forearms[arm]), few.radius_mm)
        yield f"position_endstop: {_number(carriage_mm - drop_mm)}"


def _stepper(few: ReducedParameters, arm: int) -> Iterator[str]:
    reading = few.joint_axis.text(few.endstop, "g")
    yield ""
    yield f"[stepper_{'abc'[arm]}]"
    yield f"# arm {arm}; its switch at the reading {reading}"
    yield f"angle: {_number(few.angles_deg[arm])}"


def _drop_mm(forearm_mm: float, out_mm: float) -> float:
    """Height of a forearm's upper end above the nozzle in the middle."""
    square = forearm_mm**2 - out_mm**2
    if square < 0.0:
        raise ConfigInvalid(
            f"a forearm of {forearm_mm:.1f} mm does not reach the middle from {out_mm:.1f} mm, "
            "where its switch is taken to be",
            remedy="correct limits.joint in robot.yaml: the switch is taken to be at its upper end",
        )
    return math.sqrt(square)


_HOMED = (
    "HOME_OFFSET is of the INI file and counts at the next homing: add what stands below.",
    "Joints count anticlockwise. Set pins only while the machine is off.",
)
_OF_KLIPPER = (
    "z = 0 is the lowest place of the workspace: for a bed elsewhere, change all three",
    "position_endstop alike (and shoulder_height, if it is there). A switch that is not at the",
    "reading named with it needs another position_endstop. Only these keys change.",
)
FORMATS: Mapping[str, ControllerFormat] = {
    "linuxcnc-rotarydelta": ControllerFormat(
        "LinuxCNC's rotarydeltakins",
        DELTA.name,
        "rotarydelta.hal",
        _rotarydeltakins,
        first_arm_deg=-90.0,
        offsets="HOME_OFFSET",
        keeps=_HOMED,
    ),
    "linuxcnc-lineardelta": ControllerFormat(
        "LinuxCNC's lineardeltakins",
        LINEAR_DELTA.name,
        "lineardelta.hal",
        _lineardeltakins,
        first_arm_deg=90.0,
        offsets="HOME_OFFSET",
        keeps=_HOMED,
    ),
    "klipper-rotary-delta": ControllerFormat(
        "Klipper's rotary_delta",
        DELTA.name,
        "klipper-rotary-delta.cfg",
        _klipper_rotary,
        per_arm=True,
        angles_free=True,
        keeps=_OF_KLIPPER,
    ),
    "klipper-delta": ControllerFormat(
        "Klipper's delta",
        LINEAR_DELTA.name,
        "klipper-delta.cfg",
        _klipper_linear,
        per_arm=True,
        angles_free=True,
        keeps=_OF_KLIPPER,
    ),
}
