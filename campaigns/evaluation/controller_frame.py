"""Frame, units and arms of a controller, by some of its poses with joints and measured points.

A controller's display shows poses and joints that belong together by its own kinematics. The
nominal robot has the same kinematics in our frame: the reading of joints by which its positions are
the displayed ones up to a rigid motion says how the controller counts. Measured points say the
rest: whether lengths are what they are called, and which hand the frame has, for a symmetrical
robot in a mirror is one whose arms are counted the other way round.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations, product

import numpy as np

from campaigns.arrays import AXES, Array
from campaigns.errors import ShotsInvalid
from campaigns.files.csv_file import CsvColumn, CsvForm, number_column, parse_csv
from campaigns.fit.rigid_transforms import best_rotation
from campaigns.kinematics.mechanism import Kinematics

FEWEST = 3
FLAT = 0.02
"""Part of the points' spread below which they lie in a plane, and tell no hand."""
FITS = 0.02
"""Misfit, in parts of the spread, of a controller that holds nearly the nominal parameters."""
ALIKE = 3.0
"""A reading whose misfit is below so many times the best is as good."""
SMALLEST_MM = 0.05
"""Misfit below which readings differ by rounding alone."""
LENGTHS = {"mm": 1.0, "m": 1000.0, "inch": 25.4, "cm": 10.0}
POINT = ("point_x_mm", "point_y_mm", "point_z_mm")
RIGHT_ANGLE_TOLERANCE = 0.02


@dataclass(frozen=True, slots=True, eq=False)
class DisplayedPoses:
    """What a controller displayed, as numbers, and points in the tracker's frame."""

    poses: Array
    """(N, t)"""
    joints: Array
    """(N, n)"""
    points_mm: Array | None
    """(N, 3)"""


@dataclass(frozen=True, slots=True, eq=False)
class ControllerReading:
    """Way in which a controller may count, and what it leaves unexplained."""

    order: tuple[int, ...]
    """Its joint, from 0, that is each of ours."""
    sign: float
    joints_in: str
    lengths_in: str
    mirrored: bool
    rotation: Array
    """Its axes in our base frame, as columns, (3, 3)."""
    origin_mm: Array
    """Its origin in our base frame, (3,)."""
    turn: tuple[float, float] | None
    """Sign and offset (rad) of its turn; None of a plate that does not turn."""
    misfit_mm: float
    """Root mean square distance of displayed positions from those at the joints."""

    @property
    def document(self) -> dict[str, object]:
        """The reading for programs."""
        turn = self.turn and {"sign": self.turn[0], "offset_deg": math.degrees(self.turn[1])}
        return {
            "joint_order": list(self.order),
            "joint_sign": self.sign,
            "joints_in": self.joints_in,
            "lengths_in": self.lengths_in,
            "left_handed": self.mirrored,
            "axes": self.rotation.tolist(),
            "origin_mm": self.origin_mm.tolist(),
            "turn": turn,
            "misfit_mm": self.misfit_mm,
        }

    def says(self) -> Iterator[str]:
        """Return the reading in words, a line each."""
        yield f"units: lengths in {self.lengths_in}, joints in {self.joints_in}"
        hand = "left-handed" if self.mirrored else "right-handed"
        origin = ", ".join(f"{mm:.1f}" for mm in self.origin_mm + 0.0)
        named = ", ".join(
            f"{axis} is our {_axis_words(column)}"
            for axis, column in zip(AXES, self.rotation.T, strict=True)
        )
        yield f"frame: its {named}; its origin is at ({origin}) mm of ours; {hand}"
        ours = ", ".join(str(place) for place in range(len(self.order)))
        its = ", ".join(str(place + 1) for place in self.order)
        signs = "with our sign" if self.sign > 0.0 else "with the other sign"
        yield f"arms: ours {ours} are its joints {its}, counted from 1, {signs}"
        if self.turn is not None:
            sign = "" if self.turn[0] > 0.0 else "−"
            yield f"turn: its turn is {sign}ours {math.degrees(self.turn[1]):+.2f}°"


@dataclass(frozen=True, slots=True, eq=False)
class FrameCheck:
    """Readings that explain what a controller displayed, the likeliest first."""

    found: tuple[ControllerReading, ...]
    """Empty: none explains it."""
    scale: float | None
    """Measured lengths over displayed ones; None without points."""
    tracker_misfit_mm: float | None
    problems: tuple[str, ...]

    @property
    def says(self) -> list[str]:
        """The check in words."""
        lines = list(self.problems)
        if self.found:
            lines += [*self.found[0].says(), f"fits to {self.found[0].misfit_mm:.3f} mm rms"]
        for other in self.found[1:]:
            lines.append(f"as good: {'; '.join(line for line in other.says())}")
        if self.tracker_misfit_mm is not None:
            lines.append(f"measured points are off by {self.tracker_misfit_mm:.2f} mm rms")
        return lines


def parse_displayed(text: str, name: str, nominal: Kinematics) -> DisplayedPoses:
    """Return poses of a CSV file of a controller's numbers, without units; raise `ShotsInvalid`."""
    mechanism = nominal.mechanism
    own = (*(axis.name for axis in mechanism.task), *(axis.name for axis in mechanism.joints))
    columns = (
        *(number_column(each, required=True) for each in own),
        *map(number_column, POINT),
        CsvColumn("name"),
    )
    rows = list(parse_csv(text, name, CsvForm(columns, ShotsInvalid)))
    if len(rows) < FEWEST:
        raise ShotsInvalid(
            f"{name}: holds {len(rows)} poses, at least {FEWEST} say a frame",
            remedy="give more, far apart and at different heights",
        )
    values = np.array([row.values(own) for row in rows])
    told = any(row.text(POINT[0]) for row in rows)
    points = [row.values(POINT) for row in rows] if told else None
    task = len(mechanism.task)
    return DisplayedPoses(
        values[:, :task], values[:, task:], None if points is None else np.array(points)
    )


def check_frame(nominal: Kinematics, shown: DisplayedPoses, where: str) -> FrameCheck:
    """Compare a controller's numbers with the nominal robot, and with measured points.

    `where` names the file. Raises `ShotsInvalid` for poses that lie on a line, and for joints that
    no reading lets be assembled.
    """
    spread = np.linalg.svd(shown.poses[:, :3] - shown.poses[:, :3].mean(axis=0), compute_uv=False)
    if spread[1] <= FLAT * spread[0]:
        raise ShotsInvalid(f"{where}: the poses lie on a line", remedy="give others, far apart")
    flat = len(shown.poses) == FEWEST or bool(spread[2] <= FLAT * spread[0])
    tried = sorted(_readings(nominal, shown), key=lambda each: each.misfit_mm)
    if not tried:
        raise ShotsInvalid(
            f"{where}: however its joints are read, the nominal robot cannot be assembled there",
            remedy="look at the joints' zeros, and whether robot.yaml is this robot",
        )
    best, problems = tried[0], list[str]()
    spread_mm = LENGTHS[best.lengths_in] * float(spread[0]) / math.sqrt(len(shown.poses))
    limit_mm = max(ALIKE * best.misfit_mm, SMALLEST_MM)
    found = [each for each in tried if each.misfit_mm <= limit_mm]
    # of what symmetry cannot tell apart, the frame nearest to ours comes first
    found.sort(key=lambda each: -round(float(np.trace(each.rotation)), 3))
    scale, misfit_mm, left_handed = None, None, False
    if shown.points_mm is not None:
        scale, misfit_mm, left_handed = _by_points(best, shown)
        left_handed = left_handed and not flat
    found = [each for each in found if each.mirrored == left_handed] or found
    if left_handed:
        problems.append(
            "displayed poses and measured points are mirrored against each other: a sign is wrong "
            "in one of them"
        )
    if flat:
        problems.append(
            "the poses lie in a plane and do not tell the hand of the frame: give another, higher "
            "or lower"
        )
    if best.misfit_mm > FITS * spread_mm:
        problems.append(
            f"no reading explains the joints: the best leaves {best.misfit_mm:.1f} mm, limit "
            f"{FITS * spread_mm:.1f}: look at the joints' zeros and single signs, and at robot.yaml"
        )
        found = []
    if scale is not None and abs(math.log(scale)) > FITS:
        problems.append(f"measured distances are {scale:.3f} times the displayed ones")
    return FrameCheck(tuple(found), scale, misfit_mm, tuple(problems))


def _readings(nominal: Kinematics, shown: DisplayedPoses) -> Iterator[ControllerReading]:
    axes = nominal.mechanism.joints
    units = {"deg": math.pi / 180.0, "rad": 1.0} if axes[0].is_revolute else LENGTHS
    for unit, sign, order in product(units, (1.0, -1.0), permutations(range(len(axes)))):
        joints = sign * units[unit] * shown.joints[:, order]
        solution = nominal.controlled.forward(joints)
        if not solution.found.all():
            continue
        for lengths, mirrored in product(LENGTHS, (False, True)):
            yield _reading(solution.values, shown, (order, sign, unit, lengths), mirrored=mirrored)


def _reading(
    ours: Array,
    shown: DisplayedPoses,
    counted: tuple[tuple[int, ...], float, str, str],
    *,
    mirrored: bool,
) -> ControllerReading:
    """Return the best frame for positions (N, t) of the nominal robot at joints so read."""
    order, sign, unit, lengths = counted
    hand = np.array([1.0, 1.0, -1.0 if mirrored else 1.0])
    its = LENGTHS[lengths] * shown.poses[:, :3] * hand
    centre_ours, centre_its = ours[:, :3].mean(axis=0), its.mean(axis=0)
    rotation, _ = best_rotation(its - centre_its, ours[:, :3] - centre_ours)
    off = ours[:, :3] - centre_ours - (its - centre_its) @ rotation.T
    turn = _turn(ours[:, -1], shown.poses[:, -1]) if ours.shape[1] > len(AXES) else None
    return ControllerReading(
        order=order,
        sign=sign,
        joints_in=unit,
        lengths_in=lengths,
        mirrored=mirrored,
        rotation=rotation * hand,
        origin_mm=centre_ours - rotation @ centre_its,
        turn=turn and turn[:2],
        misfit_mm=float(np.sqrt((off**2).sum(axis=1).mean())) + (turn[2] if turn else 0.0),
    )


def _turn(ours: Array, shown_deg: Array) -> tuple[float, float, float]:
    """Return the sign, offset (rad) and misfit (rad, as mm at 100 mm) of displayed turns, deg."""
    found = []
    for sign in (1.0, -1.0):
        away = np.radians(shown_deg) - sign * ours
        offset = math.atan2(np.sin(away).mean(), np.cos(away).mean())
        left = np.abs(np.exp(1j * (away - offset)) - 1.0)
        found.append((sign, offset, 100.0 * float(np.sqrt((left**2).mean()))))
    return min(found, key=lambda each: each[2])


def _by_points(best: ControllerReading, shown: DisplayedPoses) -> tuple[float, float, bool]:
    """Return scale, misfit (mm) and mirroring of measured points on displayed ones."""
    assert shown.points_mm is not None, "asked for"
    its = LENGTHS[best.lengths_in] * shown.poses[:, :3]
    its, points = (each - each.mean(axis=0) for each in (its, shown.points_mm))
    scale = float(np.linalg.norm(points) / np.linalg.norm(its))
    fits = []
    for hand in (1.0, -1.0):
        turned = its * np.array([1.0, 1.0, hand])
        rotation, _ = best_rotation(turned, points)
        off = points - scale * turned @ rotation.T
        fits.append(float(np.sqrt((off**2).sum(axis=1).mean())))
    return scale, min(fits), fits[1] < fits[0]


def _axis_words(direction: Array) -> str:
    """Return the direction (3,) as an axis such as −y, or by its numbers."""
    place = int(np.argmax(np.abs(direction)))
    rest = np.delete(direction, place)
    if np.abs(rest).max() < RIGHT_ANGLE_TOLERANCE:
        return f"{'−' if direction[place] < 0.0 else ''}{AXES[place]}"
    return f"({', '.join(f'{each:.3f}' for each in direction)})"
