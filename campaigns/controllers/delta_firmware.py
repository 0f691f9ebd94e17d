"""Firmware of Delta printers: its ten parameters that come nearest to an identified printer.

Klipper, Marlin and RepRapFirmware compute with upright towers on one circle: its radius less the
platform's, and for each tower its direction, the length of its rods and its end stop. Where one
stands is stated as the height of the nozzle, in the middle, over z = 0: that of the carriage at its
end stop less √(rod² − radius²). By the documentation of

- Klipper (Config_Reference): `delta_radius`, `arm_length`, `angle`, `position_endstop`;
- Marlin (M665, M666): R, L and A B C, added to L for towers 1 to 3; X Y Z, degrees anticlockwise
  that towers stand off 210°, 330° and 90°; H, the nozzle's height after homing; the carriages go
  down from their end stops by −(M666 X Y Z), which are 0 or less;
- RepRapFirmware (M665, M666): R, L of three lengths; X Y Z as Marlin's; H; M666 X Y Z are added to
  the heights of the end stops, so that a positive one brings the nozzle closer to the bed.

The values are those with the least mean square error of position over the workspace, at the joints
that the identified printer has there. The frame is where it fits best, but for a touched bed: z is
the height above it, end stops are levelled by its touches last of all, since a first layer has to
be level, and rods keep their identified lengths: others would lose hardly less, and contradict
callipers.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import permutations
from typing import Literal, Self, get_args

import numpy as np

from campaigns.arrays import Array
from campaigns.controllers.projection import LEAST_SHARE, MOST_ROUNDS, SETTLED_MM
from campaigns.errors import IdentificationRefused
from campaigns.fit.error_model import frame_columns
from campaigns.fit.rigid_transforms import Transform, fit_transform
from campaigns.fit.uncertainty import without_motions
from campaigns.kinematics.catalog import LINEAR_DELTA
from campaigns.kinematics.mechanism import Mechanism
from campaigns.kinematics.model import Kinematics

FirmwareWord = Literal["klipper", "marlin", "reprap"]
FIRMWARE: tuple[FirmwareWord, ...] = get_args(FirmwareWord)
TOWERS_DEG = {"X": 210.0, "Y": 330.0, "Z": 90.0}
"""Directions of the towers that Marlin and RepRapFirmware correct."""
RODS = range(4, 7)
"""Places of the rods among a firmware's ten values."""
ON_BED, ALL = (2, 3, 4), tuple(range(6))
"""Free motions of the firmware's frame, of three turns and three shifts."""
SAME = 1e-9
"""Steps below this share of the largest are no change of position, such as a turn of all towers."""
TOUCH_MM = 0.01
"""Distance of a touch from the bed's plane below which it counts as on it."""


@dataclass(frozen=True, slots=True)
class FirmwareDelta:
    """Printer as its firmware has it."""

    radius_mm: float
    arms_mm: tuple[float, ...]
    angles_deg: tuple[float, ...]
    endstops_mm: tuple[float, ...]
    """Heights of the nozzle, in the middle, when each end stop triggers."""


@dataclass(frozen=True, slots=True)
class Bed:
    """Plane of a bed, z = a x + b y + c in the base frame."""

    slopes: tuple[float, float]
    height_mm: float

    @classmethod
    def of(cls, points: Array, heights_mm: Array) -> Self:
        """Return the plane under touched points (M, 3) at heights (M,) above it."""
        columns = np.column_stack([points[:, :2], np.ones(len(points))])
        levels, weights = points[:, 2] - heights_mm, np.ones(len(points))
        # a wrong touch must not tilt the bed: least sum of distances, by weights of 1 / distance
        for _ in range(MOST_ROUNDS):
            root = np.sqrt(weights)
            plane = np.linalg.lstsq(root[:, None] * columns, root * levels, rcond=None)[0]
            weights = 1.0 / np.maximum(np.abs(levels - columns @ plane), TOUCH_MM)
        a, b, c = plane.tolist()
        return cls((a, b), c)

    @property
    def tilt_mrad(self) -> float:
        """Angle between the bed's normal and z."""
        return 1e3 * math.atan(math.hypot(*self.slopes))

    @property
    def from_base(self) -> Transform:
        """Bed's frame from the base's: z across the bed, x along that of the base."""
        (a, b), c = self.slopes, self.height_mm
        z = np.array([-a, -b, 1.0]) / math.sqrt(1.0 + a * a + b * b)
        x = np.array([1.0, 0.0, a]) / math.hypot(1.0, a)
        rotation = np.stack([x, np.cross(z, x), z])
        return Transform(rotation, -rotation @ np.array([0.0, 0.0, c]))

    def above(self, points: Array) -> Array:
        """Return points (M, 3) with their heights above the bed instead of z."""
        a, b = self.slopes
        height = points[:, 2] - self.height_mm - points[:, :2] @ np.array([a, b])
        return np.column_stack([points[:, :2], height])


@dataclass(frozen=True, slots=True, eq=False)
class FirmwareProjection:
    """Nearest values of a firmware, and the errors that they leave."""

    values: FirmwareDelta
    kinematics: Kinematics
    """The same as parameters of a linear Delta."""
    errors_mm: Array
    """Sizes of its position errors over the workspace, (M,)."""
    bed: Bed | None
    """Bed that z = 0 is of; None: the base frame's."""


@dataclass(frozen=True, slots=True, eq=False)
class Touches:
    """Touches of a bed."""

    joints: Array
    """Readings (M, n)."""
    heights_mm: Array
    """Measured heights of the nozzle above it, (M,)."""


def has_firmware(mechanism: Mechanism) -> bool:
    """Return whether the firmware of printers computes a mechanism."""
    return mechanism.name == LINEAR_DELTA.name


def project_firmware(
    identified: Kinematics, poses: Array, switch_mm: float, touches: Touches | None = None
) -> FirmwareProjection:
    """Return the values of a printer's firmware that come nearest to an identified printer.

    `poses` (N, 3) are spread over the workspace, `switch_mm` is the reading of a joint at its end
    stop. `touches` are of the bed that z = 0 is of; None: it is that of the base frame. Raise
    `IdentificationRefused` for another mechanism than a linear Delta, or if the identified robot
    can take too few of the poses, or the firmware's cannot be assembled at its joints.
    """
    mechanism, columns = identified.mechanism, identified.mechanism.parameters.columns
    if not has_firmware(mechanism):
        raise IdentificationRefused(
            f"firmware of printers computes no {mechanism.name}, but upright towers alone",
            remedy="`pkmcal export DIR` writes a robot file, --format plain one of plain values",
        )
    solution = identified.inverse(poses, _approaches(len(poses), len(mechanism.joints)))
    if solution.is_solved.sum() < LEAST_SHARE * len(poses):
        raise IdentificationRefused(
            f"the identified robot can take {solution.is_solved.sum()} of {len(poses)} poses of "
            f"the workspace (limit {100.0 * LEAST_SHARE:g} %)",
            remedy="correct limits in robot.yaml or `space` in campaign.yaml",
        )
    joints, points = solution.values[solution.is_solved], poses[solution.is_solved, :3]
    x, y, arms, offsets = (
        identified.p[columns[stem]] for stem in ("x", "y", "forearm", "joint_offset")
    )
    start = np.hstack([np.hypot(x, y).mean(), np.arctan2(y, x), arms, offsets])
    bed = None
    if touches is None:
        values = _nearest(identified, start, joints, points, is_on_bed=False)
    else:
        touched = identified.forward(touches.joints).values_or_raise()[:, :3]
        bed = Bed.of(touched, touches.heights_mm)
        # Upright towers cannot follow a bed that leans to them, but heights above it can be right
        # all over the workspace: x and y then go along the towers, as in a sheared frame.
        values = _nearest(identified, start, joints, bed.above(points), is_on_bed=True)
        values = _levelled(identified, values, touches.joints, bed.above(touched)[:, 2])
        points = bed.from_base.apply(points)
    reached = _positions(_towers(identified, values), joints, points)
    fitted = _fit(reached, points, is_on_bed=bed is not None)
    if bed is None:  # its shift along z is a height of the end stops
        values[7:] += fitted.translation_mm[2]
    radius, arms, tops = float(values[0]), values[4:7], values[7:] + switch_mm
    return FirmwareProjection(
        FirmwareDelta(
            radius,
            tuple(arms.tolist()),
            tuple((np.degrees(values[1:4]) % 360.0).tolist()),
            tuple((tops - np.sqrt(arms**2 - radius**2)).tolist()),
        ),
        _towers(identified, values),
        np.asarray(np.linalg.norm(fitted.apply(reached) - points, axis=1)),
        bed,
    )


def _nearest(
    identified: Kinematics, values: Array, joints: Array, wanted: Array, *, is_on_bed: bool
) -> Array:
    """Return the values (10,) with least errors at joints (M, n) from wanted points (M, 3)."""
    free = [place for place in range(10) if not (is_on_bed and place in RODS)]
    for _ in range(MOST_ROUNDS):
        controller = _towers(identified, values)
        reached = _positions(controller, joints, wanted)
        fitted = _fit(reached, wanted, is_on_bed=is_on_bed)
        errors = fitted.apply(reached) - wanted
        by_parameter = controller.jacobian(joints, reached)[:, :3]
        slopes = fitted.rotation @ by_parameter @ _by_values(identified, values)[:, free]
        motions = frame_columns(wanted + errors)[..., list(ON_BED if is_on_bed else ALL)]
        rows = without_motions(slopes, motions).reshape(errors.size, -1)
        step = np.linalg.lstsq(rows, -errors.ravel(), rcond=SAME)[0]
        values = values.copy()
        values[free] += step
        if np.abs(rows @ step).max() < SETTLED_MM:
            break
    return values


def _levelled(identified: Kinematics, values: Array, joints: Array, heights_mm: Array) -> Array:
    """Return values (10,) whose end stops have touches at joints (M, n) at their heights (M,)."""
    near = identified.forward(joints).values_or_raise()[:, :3]
    for _ in range(MOST_ROUNDS):
        controller = _towers(identified, values)
        reached = _positions(controller, joints, near)
        slopes = controller.jacobian(joints, reached)[:, 2] @ _by_values(identified, values)[:, 7:]
        step = np.linalg.lstsq(slopes, heights_mm - reached[:, 2], rcond=None)[0]
        values = np.hstack([values[:7], values[7:] + step])
        if np.abs(step).max() < SETTLED_MM:
            break
    return values


def _positions(controller: Kinematics, joints: Array, near: Array) -> Array:
    """Return the points (M, 3) at joints; raise `IdentificationRefused` without an assembly."""
    reached = controller.forward(joints, near)
    if not reached.is_solved.all():
        raise IdentificationRefused(
            "the firmware's kinematics cannot be assembled all over the workspace",
            remedy="correct limits in robot.yaml or `space` in campaign.yaml",
        )
    return reached.values[:, :3]


def firmware_text(firmware: FirmwareWord, values: FirmwareDelta, notes: Iterable[str]) -> str:
    """Return the values in a firmware's words, after notes as comments, one a line."""
    sign = "#" if firmware == "klipper" else ";"
    lines = {"klipper": _klipper, "marlin": _marlin, "reprap": _reprap}[firmware](values)
    return "".join(f"{line}\n" for line in [*(f"{sign} {note}" for note in notes), *lines])


def _approaches(poses: int, joints: int) -> Array:
    """Return directions of arrival (N, n), by which backlash acts: all of them equally often."""
    return np.where(np.arange(poses)[:, None] >> np.arange(joints) & 1, 1.0, -1.0)


def _fit(points: Array, wanted: Array, *, is_on_bed: bool) -> Transform:
    """Return the best motion of the firmware's frame: any, or on the bed alone."""
    if not is_on_bed:
        return fit_transform(points, wanted)
    flat = np.array([1.0, 1.0, 0.0])
    return fit_transform(points * flat, wanted * flat)


# v = (R, three directions, three rods, three offsets)
def _towers(identified: Kinematics, values: Array) -> Kinematics:
    """Return the linear Delta of a firmware's values (10,), mm and rad."""
    columns, p = identified.mechanism.parameters.columns, np.zeros_like(identified.p)
    p[columns["x"]] = values[0] * np.cos(values[1:4])
    p[columns["y"]] = values[0] * np.sin(values[1:4])
    p[columns["elevation"]] = math.pi / 2.0
    p[columns["forearm"]], p[columns["joint_offset"]] = values[4:7], values[7:]
    return Kinematics(identified.mechanism, p)


def _by_values(identified: Kinematics, values: Array) -> Array:
    """Return the derivatives of the parameters by a firmware's values, (P, 10)."""
    columns, by = identified.mechanism.parameters.columns, np.zeros((len(identified.p), 10))
    cos, sin = np.cos(values[1:4]), np.sin(values[1:4])
    by[columns["x"], 0], by[columns["y"], 0] = cos, sin
    by[columns["x"], range(1, 4)], by[columns["y"], range(1, 4)] = -values[0] * sin, values[0] * cos
    by[columns["forearm"], range(4, 7)] = by[columns["joint_offset"], range(7, 10)] = 1.0
    return by


def _klipper(values: FirmwareDelta) -> list[str]:
    lines = ["[printer]", "kinematics: delta", f"delta_radius: {values.radius_mm:.6f}"]
    of_towers = zip("abc", values.arms_mm, values.angles_deg, values.endstops_mm, strict=True)
    for tower, arm_mm, angle_deg, endstop_mm in of_towers:
        lines += [f"[stepper_{tower}]", f"arm_length: {arm_mm:.6f}", f"angle: {angle_deg:.6f}"]
        lines += [f"position_endstop: {endstop_mm:.6f}"]
    return lines


def _marlin(values: FirmwareDelta) -> list[str]:
    order, angles = _towers_of(values)
    arms = [values.arms_mm[arm] for arm in order]
    stops = [values.endstops_mm[arm] for arm in order]
    rod_mm, height_mm = sum(arms) / len(arms), min(stops)
    sizes = f"L{rod_mm:.4f} R{values.radius_mm:.4f} H{height_mm:.4f}"
    trims = _words("ABC", [arm - rod_mm for arm in arms])
    return [
        *_noted(order),
        f"M665 {sizes} {_words('XYZ', angles)} {trims}",
        f"M666 {_words('XYZ', [height_mm - stop for stop in stops])}",
    ]


def _reprap(values: FirmwareDelta) -> list[str]:
    order, angles = _towers_of(values)
    stops = [values.endstops_mm[arm] for arm in order]
    height_mm = sum(stops) / len(stops)
    rods = ":".join(f"{values.arms_mm[arm]:.4f}" for arm in order)
    return [
        *_noted(order),
        f"M665 L{rods} R{values.radius_mm:.4f} H{height_mm:.4f} {_words('XYZ', angles)}",
        f"M666 {_words('XYZ', [stop - height_mm for stop in stops])} A0 B0",
    ]


def _words(letters: str, numbers: Iterable[float]) -> str:
    return " ".join(f"{a}{round(b, 4) + 0.0:.4f}" for a, b in zip(letters, numbers, strict=True))


def _noted(order: tuple[int, ...]) -> list[str]:
    named = ", ".join(f"{a} is arm{arm}" for a, arm in zip(TOWERS_DEG, order, strict=True))
    return [f"; towers: {named}"]


def _towers_of(values: FirmwareDelta) -> tuple[tuple[int, ...], list[float]]:
    """Return the arms of towers X, Y and Z by their directions, and how far each is off, deg."""

    def off(order: tuple[int, ...]) -> list[float]:
        turns = [
            values.angles_deg[arm] - usual
            for arm, usual in zip(order, TOWERS_DEG.values(), strict=True)
        ]
        return [(turn + 180.0) % 360.0 - 180.0 for turn in turns]

    order = min(permutations(range(3)), key=lambda order: sum(map(abs, off(order))))
    return order, off(order)
