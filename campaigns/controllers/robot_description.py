"""Robot descriptions, URDF and SDF, of the contracted model: a tree of links in m and rad.

The platform hangs on three prismatic joints that stand for the parallelograms, which keep it level,
and on its turn; each arm with its forearm is a branch of its own. What closes the loops, the end of
each forearm in its place on the platform, URDF cannot say and has as comments; SDF has ball joints.
What gears and encoders add, and what tilts a plate, is left out.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal
from xml.sax.saxutils import quoteattr

import numpy as np
from scipy.spatial.transform import Rotation

from campaigns.arrays import AXES, Array
from campaigns.mechanisms.mechanism import Interval, Kinematics
from campaigns.robots.robot import RobotFile
from campaigns.version import VERSION

M_PER_MM = 1e-3
UPRIGHT = 1e-9
FREE_M, FREE_RAD = (-10.0, 10.0), (-np.pi, np.pi)
Kind = Literal["revolute", "prismatic", "fixed"]


@dataclass(frozen=True, slots=True, eq=False)
class Joint:
    """Joint of the tree; it is named as the link that it holds, which begins there."""

    name: str
    parent: str
    kind: Kind = "fixed"
    place_m: Array = field(default_factory=lambda: np.zeros(3))
    turn: Rotation = field(default_factory=Rotation.identity)
    """Of the child's axes in the parent's, at a value of 0."""
    axis: tuple[float, float, float] = (0.0, 0.0, 1.0)
    limits: Interval = FREE_RAD
    mimics: tuple[str, float] | None = None
    """Joint that it follows, and its multiplier."""
    value: float = 0.0
    """At the workspace's centre, rad or m."""

    def at_centre(self) -> "Joint":
        """The joint with a value of 0 at the workspace's centre."""
        along = self.value * np.array(self.axis)
        if self.kind == "revolute":
            return replace(self, turn=self.turn * Rotation.from_rotvec(along))
        return replace(self, place_m=self.place_m + self.turn.apply(along))


def robot_description(robot: RobotFile, language: str) -> str:
    """Text of a robot's description, URDF or SDF."""
    joints = list(_joints(robot))
    arms = range(len(robot.mechanism.joints))
    lines = (_urdf if language == "urdf" else _sdf)(robot.name, joints, arms)
    return "".join(f"{line}\n" for line in lines)


def _joints(robot: RobotFile) -> Iterator[Joint]:
    """Joints of a robot, parents first."""
    model, centre = robot.kinematics.controlled, robot.workspace_centre
    readings = model.inverse(centre[None]).values_or_raise()[0]
    turn = robot.mechanism.task[-1].name
    for name, parent, axis in zip(AXES, ("base", "x", "y"), np.eye(3), strict=True):
        along = tuple(axis.tolist())
        value = M_PER_MM * float(centre[AXES.index(name)])
        yield Joint(name, parent, "prismatic", axis=along, limits=FREE_M, value=value)
    if len(centre) > len(AXES):
        limits = robot.limits.task[-1] or FREE_RAD
        yield Joint(turn, "z", "revolute", limits=limits, value=float(centre[-1]))
    places = _on_platform(model)
    for arm, (still, turned, slid) in enumerate(places):
        parent = "z"
        if slid:
            parent = f"bar{arm}"
            factor, x = M_PER_MM * slid, (1.0, 0.0, 0.0)
            value = factor * float(centre[-1])
            mimics = (turn, factor)
            yield Joint(parent, "z", "prismatic", axis=x, limits=FREE_M, mimics=mimics, value=value)
        elif turned:
            parent = turn
        yield Joint(f"plate{arm}", parent, place_m=M_PER_MM * still)
    flat = model.parameters
    for arm, reading in enumerate(readings.tolist()):
        own = {each: flat.get(f"arm{arm}.{each}", 0.0) for each in _FIELDS}
        crank = robot.mechanism.joints[arm].is_revolute
        joint = _crank(arm, own, robot, reading) if crank else _carriage(arm, own, robot, reading)
        yield joint
        tip_m = M_PER_MM * own["arm_mm"] * np.array([1.0, 0.0, 0.0])
        here = joint.at_centre()
        elbow_m = here.place_m + here.turn.apply(tip_m)
        still, turned, slid = places[arm]
        bent = _bent(here.turn.inv().apply(M_PER_MM * _target(centre, places[arm]) - elbow_m))
        lift, swing = f"lift{arm}", f"forearm{arm}"
        y, z = (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)
        yield Joint(lift, joint.name, "revolute", tip_m, axis=y, value=bent[0])
        yield Joint(swing, lift, "revolute", axis=z, value=bent[1])
        length_m = M_PER_MM * own["forearm_mm"] * np.array([1.0, 0.0, 0.0])
        yield Joint(f"end{arm}", swing, place_m=length_m)


_FIELDS = (
    *("x_mm", "y_mm", "z_mm", "azimuth_deg", "axis_tilt_deg", "joint_offset_deg", "arm_mm"),
    *("elevation_deg", "rail_tilt_deg", "joint_offset_mm", "forearm_mm"),
)
Place = tuple[Array, bool, float]
"""Forearm's place on the platform at turn 0, mm; whether it turns with it; slide, mm/rad."""


def _on_platform(model: Kinematics) -> list[Place]:
    mechanism, count = model.mechanism, len(model.mechanism.task)
    own = mechanism.parameters.platform_fields
    values = np.array([model.parameters[each.name] for each in own])
    poses = np.zeros((2, count))
    if count > len(AXES):
        poses[1, -1] = 1.0
    still, moved = mechanism.platform.joints_mm(values, poses)
    slides = [not one.any() and bool(other.any()) for one, other in zip(still, moved, strict=True)]
    return [
        (one, bool(one.any()), float(other[0]) if slid else 0.0)
        for one, other, slid in zip(still, moved, slides, strict=True)
    ]


def _target(centre: Array, place: Place) -> Array:
    """Forearm's end at the workspace's centre, mm."""
    still, turned, slid = place
    turn = float(centre[-1]) if len(centre) > len(AXES) else 0.0
    along = Rotation.from_euler("z", turn if turned else 0.0).apply(still)
    return np.asarray(centre[:3] + along + slid * turn * np.array([1.0, 0.0, 0.0]))


def _bent(forearm_m: Array) -> tuple[float, float]:
    """Turns about y and then z that lay x along a forearm, rad."""
    x, y, z = forearm_m / np.linalg.norm(forearm_m)
    return float(np.arctan2(-z, x)), float(np.arcsin(y))


def _crank(arm: int, own: dict[str, float], robot: RobotFile, reading: float) -> Joint:
    place_m = M_PER_MM * np.array([own["x_mm"], own["y_mm"], own["z_mm"]])
    angles = own["azimuth_deg"], own["axis_tilt_deg"], own["joint_offset_deg"]
    turn = Rotation.from_euler("ZXY", angles, degrees=True)
    name, limits = f"arm{arm}", robot.limits.joint
    y = (0.0, 1.0, 0.0)
    return Joint(name, "base", "revolute", place_m, turn, y, limits, value=reading)


def _carriage(arm: int, own: dict[str, float], robot: RobotFile, reading: float) -> Joint:
    zero_m = M_PER_MM * np.array([own["x_mm"], own["y_mm"], own["z_mm"]])
    angles = own["azimuth_deg"], -own["elevation_deg"], own["rail_tilt_deg"]
    rail = Rotation.from_euler("ZYZ", angles, degrees=True).apply([1.0, 0.0, 0.0])
    x, y, z = rail.tolist()
    low, high = robot.limits.joint
    return Joint(
        f"arm{arm}",
        "base",
        "prismatic",
        zero_m + M_PER_MM * own["joint_offset_mm"] * rail,
        axis=(x, y, z),
        limits=(M_PER_MM * low, M_PER_MM * high),
        value=M_PER_MM * reading,
    )


def _numbers(values: Sequence[float] | Array) -> str:
    return " ".join(f"{value + 0.0:.9g}" for value in values)


def _turned(joint: Joint) -> str:
    """Roll, pitch and yaw, rad; where the pitch is a right angle the roll is 0."""
    own = joint.turn.as_matrix()
    level = float(np.hypot(own[0, 0], own[1, 0]))
    pitch = np.arctan2(-own[2, 0], level)
    if level < UPRIGHT:
        return _numbers([0.0, pitch, np.arctan2(-own[0, 1], own[1, 1])])
    return _numbers([np.arctan2(own[2, 1], own[2, 2]), pitch, np.arctan2(own[1, 0], own[0, 0])])


def _urdf(name: str, joints: Sequence[Joint], arms: Sequence[int]) -> Iterator[str]:
    yield '<?xml version="1.0"?>'
    yield f"<!-- pkmcal {VERSION}; joints arm0, arm1 ... are the encoders', in rad or m -->"
    yield f"<robot name={quoteattr(name)}>"
    yield '  <link name="base"/>'
    for joint in joints:
        yield f'  <link name="{joint.name}"/>'
        yield f'  <joint name="{joint.name}_joint" type="{joint.kind}">'
        yield f'    <parent link="{joint.parent}"/><child link="{joint.name}"/>'
        yield f'    <origin xyz="{_numbers(joint.place_m)}" rpy="{_turned(joint)}"/>'
        if joint.kind != "fixed":
            low, high = joint.limits
            yield f'    <axis xyz="{_numbers(joint.axis)}"/>'
            yield f'    <limit lower="{low:.9g}" upper="{high:.9g}" effort="0" velocity="0"/>'
        if joint.mimics:
            source, factor = joint.mimics
            yield f'    <mimic joint="{source}_joint" multiplier="{factor:.9g}"/>'
        yield "  </joint>"
    yield from (f"  <!-- loop closure: end{arm} is in plate{arm} -->" for arm in arms)
    yield "</robot>"


def _sdf(name: str, joints: Sequence[Joint], arms: Sequence[int]) -> Iterator[str]:
    yield '<?xml version="1.0"?>'
    yield '<sdf version="1.11">'
    yield f"  <model name={quoteattr(name)}>"
    values = ", ".join(f"{joint.name} {joint.value:.9g}" for joint in joints if joint.value)
    yield f"    <!-- pkmcal {VERSION}; positions count from the workspace's centre, where are:"
    yield f"         {values} -->"
    yield '    <link name="base"/>'
    ends = "<parent>world</parent><child>base</child>"
    yield f'    <joint name="mount" type="fixed">{ends}</joint>'
    for joint in map(Joint.at_centre, joints):
        pose = f"{_numbers(joint.place_m)} {_turned(joint)}"
        yield f'    <link name="{joint.name}">'
        yield f'      <pose relative_to="{joint.parent}">{pose}</pose>'
        yield "    </link>"
        yield f'    <joint name="{joint.name}_joint" type="{joint.kind}">'
        yield f"      <parent>{joint.parent}</parent><child>{joint.name}</child>"
        if joint.kind != "fixed":
            low, high = (end - joint.value for end in joint.limits)
            limit = f"<limit><lower>{low:.9g}</lower><upper>{high:.9g}</upper></limit>"
            mimic = ""
            if joint.mimics:
                source, factor = joint.mimics
                mimic = (
                    f'<mimic joint="{source}_joint"><multiplier>{factor:.9g}</multiplier>'
                    "<offset>0</offset><reference>0</reference></mimic>"
                )
            yield f"      <axis><xyz>{_numbers(joint.axis)}</xyz>{limit}{mimic}</axis>"
        yield "    </joint>"
    for arm in arms:
        ends = f"<parent>plate{arm}</parent><child>end{arm}</child>"
        yield f'    <joint name="closure{arm}" type="ball">{ends}</joint>'
    yield "  </model>"
    yield "</sdf>"
