"""Where to observe: candidates for each kind, and the best of them.

A bed is touched, a part drawn and an edge followed in a plane; a reflector and a probe are seen by
the tracker wherever the robot may take them. Of some hundred such poses, drawn at random, those are
planned after which the wanted quantity is known best (`outlook.py`).
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import scipy

from campaigns.arrays import AXES, Array
from campaigns.design.pose_sampling import (
    FeasibleRegion,
    WorkspaceTooSmall,
    interior_poses,
    poses_at_level,
    workspace_poses,
)
from campaigns.errors import OptionsInvalid, PlanInvalid
from campaigns.files.wording import shown, suggestion
from campaigns.fit.kinds import KINDS, Kind
from campaigns.fit.tracker_noise import TrackerUncertainty, point_covariance_mm2
from campaigns.identification.objects import Object
from campaigns.identification.other_kinds import Measured
from campaigns.planning.paths import RobotModel

CANDIDATES = 300
"""Poses, or pairs of poses, of which the best are chosen."""
SHORTEST_MM, LONGEST_MM = 30.0, 150.0
"""Lengths of a drawn part between which common callipers measure well."""
LARGEST_COUNT = 1000
"""Largest number of observations of one object."""


@dataclass(frozen=True, slots=True)
class Usual:
    """What one observation of a kind usually has and takes, by hand."""

    std_mm: float
    """1 σ of a value; of a turn that of points 100 mm apart."""
    seconds: float
    """Time that it takes, the way to it included."""


USUAL: Mapping[str, Usual] = {
    "height": Usual(0.01, 20.0),  # a dial gauge, or paper under the nozzle
    "block": Usual(0.01, 40.0),  # the block is moved along
    "distance": Usual(0.03, 60.0),  # callipers at a part that was drawn
    "inclinometer": Usual(0.02, 30.0),  # 0.01°
    "edge": Usual(0.02, 30.0),
    "place": Usual(0.02, 30.0),
    "ball-bar": Usual(0.002, 20.0),
}
"""Kinds that no tracker measures; the σ is written into observations.csv, where it may be
corrected."""
WITHOUT_LENGTH = frozenset({"height", "edge", "inclinometer"})
"""Kinds that say nothing of the size of a robot: a larger one touches larger planes alike."""
KIND_OF_NAME = {"bed": "height", "table": "height", "part": "distance"}
"""Kinds of objects by words of their names, beside the kinds' own names."""


@dataclass(frozen=True, slots=True)
class WantedObservations:
    """So many observations of one kind at one object, to be planned."""

    thing: Object
    kind: str
    count: int


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class ObservedCell:
    """Robot and instruments that observations are planned for."""

    robot: RobotModel
    region: FeasibleRegion | None
    """Where the tracker sees the reflector; None: there is no tracker."""
    instrument: TrackerUncertainty
    measuring_s: float = 0.0
    """Time that the robot and the tracker take for a shot."""

    def std_mm(self, kind: Kind, points: Array) -> float:
        """Return 1 σ of a value of a kind, about points (M, 3) in the base frame."""
        if self.region is None or not kind.by_tracker:
            return USUAL[kind.name].std_mm
        covariance = point_covariance_mm2(points - self.region.view_from_mm, self.instrument)
        return float(np.sqrt(np.trace(covariance, axis1=1, axis2=2).mean() / len(AXES)))

    def seconds(self, kind: str) -> float:
        """Return the time that an observation of a kind takes, or a "shot"."""
        if kind in USUAL:
            return USUAL[kind].seconds
        return self.measuring_s * (len(KINDS[kind].points) if kind in KINDS else 1)


def kind_of(thing: Object) -> str:
    """Return the kind of observation that an object is for; raise `OptionsInvalid` if any may be.

    A kind in its name decides, else what is stated of it.
    """
    words = thing.name.lower().split()
    stated = {
        "ball-bar": thing.length_mm is not None,
        "probe": thing.turn_deg is not None or thing.turn_std_deg is not None,
        "reflectors": thing.body is not None and thing.support.body not in (None, thing.body),
        "reflector": thing.body is not None,
        "block": thing.on is not None and thing.height_mm is not None,
        "distance": thing.shrinkage_std_percent is not None,
    }
    by_name = [KIND_OF_NAME.get(word, word) for word in words]
    of_name = [kind for kind in by_name if kind in KINDS]
    if kinds := [*of_name, *(kind for kind, is_stated in stated.items() if is_stated)]:
        return kinds[0]
    raise OptionsInvalid(
        f"nothing says what is observed of {shown(thing.name)}",
        remedy=f"say --observe KIND:{thing.name}=COUNT, with a kind of {', '.join(KINDS)}",
    )


def read_wish(text: str, objects: Mapping[str, Object]) -> WantedObservations:
    """Read a wish such as `bed=30`, or `height:bed=30`; raise `OptionsInvalid`."""
    what, _, number = text.rpartition("=")
    kind, colon, name = what.rpartition(":")
    if not number.isascii() or not number.isdigit() or not 1 <= int(number) <= LARGEST_COUNT:
        raise OptionsInvalid(
            f"--observe {shown(text)}: a number from 1 to {LARGEST_COUNT} must follow the object",
            remedy="write it as bed=30",
        )
    if name not in objects:
        raise OptionsInvalid(
            f"--observe {shown(name) or 'without a name'} is no object of campaign.yaml",
            remedy=suggestion(name, tuple(objects))
            if objects
            else f"list it there: `objects: [{{name: {name or 'bed'}}}]`",
        )
    if colon and kind not in KINDS:
        raise OptionsInvalid(
            f"--observe {shown(kind)} is no kind of observation",
            remedy=suggestion(kind, tuple(KINDS)),
        )
    return WantedObservations(objects[name], kind or kind_of(objects[name]), int(number))


def candidates_of(
    wish: WantedObservations, cell: ObservedCell, rng: np.random.Generator
) -> Measured:
    """Return observations of an object at poses drawn for its kind, with the values expected there.

    Raise `PlanInvalid` where too few poses can be taken, or the kind has its poses from elsewhere.
    """
    kind, kinematics = KINDS[wish.kind], cell.robot.kinematics
    if kind.name not in _DRAWN and not kind.by_tracker:
        raise PlanInvalid(
            f"poses for {wish.thing.name} follow from where it stands, not from a plan",
            remedy=f"write its rows of the kind {kind.name} into observations.csv",
        )
    try:
        poses = _DRAWN.get(kind.name, _seen)(wish, cell, rng)
    except WorkspaceTooSmall as error:
        raise PlanInvalid(
            f"too few poses for {wish.thing.name}: {error}",
            remedy="state its place_mm: [x, y, z] in the base frame, or the bed that it is `on`; "
            "or check the robot's limits and `space` in campaign.yaml",
        ) from error
    flat = poses.reshape(-1, poses.shape[-1])
    joints = kinematics.inverse(flat).values_or_raise()
    return Measured(
        kind=wish.kind,
        object=wish.thing,
        joints=joints.reshape(*poses.shape[:2], -1) if kind.poses > 1 else joints,
        values=_expected(kind, poses, cell),
        std_mm=cell.std_mm(kind, flat[:, : len(AXES)]),
    )


# At the level that the object states, or else at z = 0, where printers have their bed.
def _on_plane(
    wish: WantedObservations, cell: ObservedCell, rng: np.random.Generator, count: int = CANDIDATES
) -> Array:
    """Draw poses (M, 1, t) of the tool at the level of an object."""
    robot, bed = cell.robot, wish.thing.support
    level_mm = 0.0 if bed.place_mm is None else bed.place_mm[2]
    if bed is not wish.thing:
        level_mm += wish.thing.height_mm or 0.0
    centre = robot.centre.copy()
    centre[2] = level_mm
    return poses_at_level(robot.kinematics, robot.limits, centre, count, rng, robot.space)[:, None]


def _pairs_on_plane(
    wish: WantedObservations, cell: ObservedCell, rng: np.random.Generator
) -> Array:
    """Draw pairs of poses (M, 2, t) at the level of an object, within callipers' reach."""
    poses = _on_plane(wish, cell, rng)[:, 0]
    first, second = rng.integers(len(poses), size=(2, 40 * CANDIDATES))
    apart_mm = np.linalg.norm(poses[first, :3] - poses[second, :3], axis=1)
    pairs = np.flatnonzero((apart_mm >= SHORTEST_MM) & (apart_mm <= LONGEST_MM))[:CANDIDATES]
    if len(pairs) < CANDIDATES:
        raise WorkspaceTooSmall(
            f"{len(pairs)} of {len(apart_mm)} pairs are {SHORTEST_MM:g} to {LONGEST_MM:g} mm apart"
        )
    return np.stack([poses[first[pairs]], poses[second[pairs]]], axis=1)


def _anywhere(wish: WantedObservations, cell: ObservedCell, rng: np.random.Generator) -> Array:  # noqa: ARG001 - as others
    """Draw poses (M, 1, t) all over the workspace."""
    robot = cell.robot
    args = (robot.kinematics, robot.limits, robot.centre, CANDIDATES, rng, robot.space)
    return workspace_poses(*args)[:, None]


def _seen(wish: WantedObservations, cell: ObservedCell, rng: np.random.Generator) -> Array:
    """Draw poses (M, k, t) at which the tracker sees the reflector."""
    if cell.region is None:
        raise PlanInvalid(
            f"{wish.thing.name} is seen by a tracker, whose frame is placed by shots",
            remedy="plan shots as well",
        )
    count = KINDS[wish.kind].poses
    poses = interior_poses(cell.region, CANDIDATES * count, rng)
    return poses.reshape(CANDIDATES, count, -1)


def _on_sphere(wish: WantedObservations, cell: ObservedCell, rng: np.random.Generator) -> Array:
    """Draw poses (M, 1, t) about the fixed ball of a bar, at the bar's length from it."""
    ball, robot = wish.thing.support, cell.robot
    if ball is wish.thing or ball.place_mm is None or wish.thing.length_mm is None:
        raise PlanInvalid(
            f"poses of {wish.thing.name} are about a fixed ball, at the bar's length from it",
            remedy="state length_mm of the bar, and place_mm of the ball that it is `on`",
        )
    directions = rng.standard_normal((40 * CANDIDATES, len(AXES)))
    directions *= wish.thing.length_mm / np.linalg.norm(directions, axis=1)[:, None]
    poses = np.tile(robot.centre, (len(directions), 1))
    poses[:, : len(AXES)] = ball.place_mm + directions
    allowed = robot.space.allows(poses[:, : len(AXES)])
    allowed[allowed] = robot.kinematics.feasibility(robot.limits, poses[allowed]).feasible
    if allowed.sum() < CANDIDATES:
        raise WorkspaceTooSmall(f"{allowed.sum()} of {len(poses)} poses tried can be taken")
    return poses[allowed][:CANDIDATES, None]


_DRAWN: Mapping[str, Callable[[WantedObservations, ObservedCell, np.random.Generator], Array]] = {
    "height": _on_plane,
    "block": _on_plane,
    "distance": _pairs_on_plane,
    "inclinometer": _anywhere,
    "ball-bar": _on_sphere,
}
"""How poses are drawn for a kind that no tracker measures."""


# Only derivatives count, so that a value need not be right: but the tracker's errors of scale and
# the search for a probe's turn begin at what it sees.
def _expected(kind: Kind, poses: Array, cell: ObservedCell) -> Array:
    """Return values (M, v) near those at poses (M, k, t); heights, lengths and tilts are 0."""
    values = np.zeros((len(poses), len(kind.columns)))
    if cell.region is None or not kind.by_tracker:
        return values
    for number, where in enumerate(kind.points):
        at = poses[:, min(number, kind.poses - 1), : len(AXES)]
        values[:, where] = at - cell.region.view_from_mm
    turns = np.flatnonzero(kind.angles).tolist()
    if turns:
        axes = cell.robot.kinematics.mechanism.tool_axes(poses[:, 0])
        values[:, turns] = scipy.spatial.transform.Rotation.from_matrix(axes).as_rotvec()
    return values
