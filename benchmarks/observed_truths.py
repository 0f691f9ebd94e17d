"""Robots whose truth is known, and what instruments read at them: of all kinds of observation.

A robot is made of single rods or bars (`sim.robot`), beside nominal by normal draws; it shares no
equation with the estimator. A cell puts instruments around it. Each reading follows from where the
robot's bodies are by the instrument's own geometry, with its noise.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from campaigns.arrays import Array
from campaigns.fit.error_model import frame_columns
from campaigns.fit.kinds import TURN_LEVER_MM
from campaigns.fit.rigid_transforms import Transform
from campaigns.identification.result import IdentificationResult
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.robots.robot import RobotFile
from pkmcal import Measured, Object, Shots, find_robot, sample_workspace
from sim.factory import true_geometry
from sim.geometry import BAR_KINDS, PLATE_KINDS, Kind, PlateKind, geometry_of
from sim.robot.bars import BarMechanism
from sim.robot.rods import Build, Mechanism, Plate, RodMechanism, rotation
from sim.robot.section import GeometrySection, RobotSection, Tolerances

TOLERANCES = Tolerances(position_mm=0.5, length_mm=0.5, joint_offset_deg=0.1, azimuth_mrad=1.0)
ROD_SPACING_MM, ROD_MM, TILT_RAD = 80.0, 0.05, 3e-4
TRACKER_FROM_BASE = Transform(rotation(0.02, -0.03, 2.1), np.array([2500.0, 400.0, 300.0]))
POINT_MM = 0.012
"""1 σ of a tracker's point on each axis."""


@dataclass(frozen=True, slots=True, eq=False)
class Stood:
    """Body of a robot where it really was: places (M, 3) and axes as columns (M, 3, 3)."""

    places: Array
    axes: Array

    def points(self, place: Sequence[float] | Array) -> Array:
        """Return where a place (3,) on the body was, (M, 3)."""
        return np.asarray(self.places + self.axes @ np.asarray(place))


class TrueBodies:
    """Robot as it was made: joints in, bodies of its platform out."""

    def __init__(self, nominal: RobotFile, seed: int) -> None:
        self.nominal = nominal
        self._mechanism = _drawn(nominal, seed)

    def stood(self, joints: Array, near: Array, half: int | None = None) -> Stood:
        """Return the tool, or a half of the platform, at joints (M, n), near poses (M, t)."""
        places, axes = [], []
        for row, pose in zip(joints, near, strict=True):
            plate = self._settled(row, pose)
            places.append(self._mechanism.reflector_mm(plate, np.zeros(3), half))
            turned = rotation(0.0, 0.0, plate.theta_rad) if half is None else np.eye(3)
            axes.append(plate.rotation @ turned)
        return Stood(np.array(places), np.array(axes))

    def _settled(self, joints: Array, pose: Array) -> Plate:
        """Return the platform at joints (n,)."""
        kind = self._mechanism.kind
        if isinstance(kind, PlateKind):
            guess = Plate.level(kind, pose[:3], float(pose[3:].sum()))
        else:
            guess = self._mechanism.plate_of(np.pad(pose, (0, 6 - len(pose))))
        return self._mechanism.settle(joints, guess).plate


def _drawn(nominal: RobotFile, seed: int) -> Mechanism:
    """Return the mechanism of a robot that was made with `TOLERANCES`."""
    mechanism = nominal.mechanism
    kind: Kind = {**PLATE_KINDS, **BAR_KINDS}[mechanism.name]
    rows: dict[str, dict[str, float]] = {}
    for name in kind.names:
        arm, _, stem = name.rpartition(".")
        rows.setdefault(arm, {})[stem] = nominal.parameters[name]
    whole = rows.pop("", {})
    section = RobotSection(
        mechanism=mechanism.name,
        geometry=GeometrySection(
            arms=tuple(rows.values()),
            plate_mm=whole.get("plate_mm"),
            pinion_mm=whole.get("pinion_mm"),
        ),
        tolerances=TOLERANCES,
    )
    flat = true_geometry(section, seed)
    if mechanism.name in BAR_KINDS:
        return BarMechanism(BAR_KINDS[mechanism.name], flat)
    assert isinstance(mechanism, ClosedChain), "all others are robots of parallelograms"
    assert mechanism.plate is not None, "every shipped robot's plate has places"
    rng, arms = np.random.default_rng((seed, 31)), len(mechanism.joints)
    build = Build(
        np.array(mechanism.plate.joints_mm),
        ROD_SPACING_MM,
        ROD_MM * rng.standard_normal((arms, 2)),
        TILT_RAD * rng.standard_normal(arms),
    )
    return RodMechanism(geometry_of(flat, PLATE_KINDS[mechanism.name]), build)


SLOPES = np.array([8e-4, -1.1e-3])
"""Slopes of the bed."""
BLOCK_MM, SHRINKAGE, BAR_MM = 30.004, 0.002, 400.0012
FIRST_MM, SECOND_MM, BALL_MM = (np.array(p) for p in ((30, 9, -20), (-40, 30, 25), (20, -15, 35)))
"""Places on their bodies: of two reflectors or of a probe, and of the ball of a bar."""
MOUNTED = rotation(0.3, -0.2, 1.2)
"""Axes of a probe or an inclinometer, seen from those of its body."""
VERTICAL = np.array([2e-3, -1e-3, 1.0]) / np.linalg.norm([2e-3, -1e-3, 1.0])
"""Where up is in the base frame."""
EDGE = np.array([4e-3, 1.0, 2e-3]) / np.linalg.norm([4e-3, 1.0, 2e-3])
"""Normal of a straight edge along x."""
PLATE_TURN = rotation(2e-3, -1e-3, 0.4)
GAUGE = np.array([0.0, 1.0, 0.0])
TURN_STD_RAD = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class TrueCell:
    """Robot with instruments around it."""

    truth: TrueBodies
    rng: np.random.Generator

    @classmethod
    def of(cls, name: str, seed: int) -> "TrueCell":
        """Return a robot of a shipped kind, drawn by a seed."""
        return cls(TrueBodies(find_robot(name), seed), np.random.default_rng((seed, 32)))

    @property
    def robot(self) -> RobotFile:
        """Nominal robot."""
        return self.truth.nominal

    @property
    def centre_mm(self) -> Array:
        """Middle of the workspace, (3,), around which instruments stand."""
        return np.asarray(self.robot.workspace_centre[:3], dtype=np.float64)

    def joints(self, poses: Array) -> Array:
        """Return the joints (M, n) that the controller commands for poses (M, t)."""
        return np.asarray(self.robot.kinematics.inverse(poses).values_or_raise().round(9))

    def on_level(self, radius_mm: float, count: int, z_mm: float = 0.0) -> Array:
        """Return poses (count, t) spread over a disc at a height above the workspace's middle."""
        numbers = np.arange(count)
        radii, angles = radius_mm * np.sqrt((numbers + 0.5) / count), 2.399963 * numbers
        poses = np.tile(np.asarray(self.robot.workspace_centre, dtype=np.float64), (count, 1))
        poses[:, :2] += np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=1)
        poses[:, 2] += z_mm
        return poses

    def noise(self, std: float, *shape: int) -> Array:
        """Draw errors of readings."""
        return np.asarray(std * self.rng.standard_normal(shape))

    def seen(self, points: Array) -> Array:
        """Return points (M, 3) as a tracker measures them."""
        return TRACKER_FROM_BASE.apply(points) + self.noise(POINT_MM, *points.shape)

    def shots(self, poses: Array, pairs: int = 0, place: Sequence[float] = (0.0,) * 3) -> Shots:
        """Measure shots of a reflector at a place on its part, the last ones as hold-out pairs."""
        joints, fitted = self.joints(poses), len(poses) - 2 * pairs
        half = 1 if self.robot.mechanism.halves else None  # which turns with no θ
        return Shots.of(
            joints,
            self.seen(self.truth.stood(joints, poses, half).points(place)),
            self.robot,
            sets=["identification"] * fitted + ["validation"] * (2 * pairs),
            pairs=[None] * fitted + [row // 2 for row in range(2 * pairs)],
            covariance_mm2=POINT_MM**2 * np.eye(3),
        )

    def measure(
        self,
        kind: str,
        thing: Object,
        poses: Array,
        std_mm: float = 0.01,
        *,
        held_out: bool = False,
    ) -> Measured:
        """Measure at poses (M, t), or between the two of each row (M, 2, t)."""
        rows = poses[:, None] if poses.ndim == 2 else poses
        bodies, joints = [], []
        for number in range(rows.shape[1]):
            joints.append(self.joints(rows[:, number]))
            bodies.append(self.truth.stood(joints[-1], rows[:, number], thing.part))
        if kind == "reflectors":
            bodies.insert(0, self.truth.stood(joints[0], rows[:, 0], thing.support.part))
        values = getattr(self, "_" + kind.replace("-", "_"))(bodies)
        if kind not in BY_TRACKER:
            values = values + self.noise(
                TURN_STD_RAD if kind == "inclinometer" else std_mm, *values.shape
            )
        return Measured(
            kind=kind,
            object=thing,
            joints=joints[0] if len(joints) == 1 else np.stack(joints, axis=1),
            values=values,
            std_mm=STATED_MM.get(kind, std_mm),
            held_out=held_out,
        )

    # --- what instruments read, without noise but for the tracker's -------------------------------

    def _height(self, bodies: Sequence[Stood]) -> Array:
        normal = np.array([*-SLOPES, 1.0]) / np.sqrt(1.0 + SLOPES @ SLOPES)
        return np.asarray((bodies[0].places - self.centre_mm) @ normal)

    def _block(self, bodies: Sequence[Stood]) -> Array:
        return self._height(bodies) - BLOCK_MM

    def _distance(self, bodies: Sequence[Stood]) -> Array:
        apart = bodies[1].places - bodies[0].places
        return np.asarray((1.0 - SHRINKAGE) * np.linalg.norm(apart, axis=1))

    def _reflector(self, bodies: Sequence[Stood]) -> Array:
        return self.seen(bodies[0].points(SECOND_MM))

    def _reflectors(self, bodies: Sequence[Stood]) -> Array:
        places = zip(bodies, (FIRST_MM, SECOND_MM), strict=True)
        return np.hstack([self.seen(body.points(place)) for body, place in places])

    def _span(self, bodies: Sequence[Stood]) -> Array:
        return np.hstack([self.seen(body.points(SECOND_MM)) for body in bodies])

    def _probe(self, bodies: Sequence[Stood]) -> Array:
        axes = TRACKER_FROM_BASE.rotation @ bodies[0].axes @ MOUNTED
        turned = Rotation.from_rotvec(self.noise(TURN_STD_RAD, len(axes), 3))
        vectors = (turned * Rotation.from_matrix(axes)).as_rotvec()
        return np.hstack([self.seen(bodies[0].points(SECOND_MM)), vectors])

    def _ball_bar(self, bodies: Sequence[Stood]) -> Array:
        centre = self.centre_mm - [30.0, 20.0, BAR_MM]
        return np.asarray(np.linalg.norm(bodies[0].points(BALL_MM) - centre, axis=1) - BAR_MM)

    def _place(self, bodies: Sequence[Stood]) -> Array:
        return np.asarray((bodies[0].places - self.centre_mm) @ PLATE_TURN)

    # The plunger runs along its axis until it meets the edge.
    def _edge(self, bodies: Sequence[Stood]) -> Array:
        along = bodies[0].axes @ GAUGE
        return np.asarray(((bodies[0].places - self.centre_mm) @ EDGE) / (along @ EDGE))

    def _inclinometer(self, bodies: Sequence[Stood]) -> Array:
        raised = VERTICAL @ (bodies[0].axes @ MOUNTED)
        return np.stack([np.arcsin(raised[:, 1]), -np.arcsin(raised[:, 0])], axis=1)

    # --- real errors ------------------------------------------------------------------------------

    def errors(
        self, result: IdentificationResult, touched: Array | None = None
    ) -> dict[str, float]:
        """Return real errors of an identified robot by quantity, rms, mm and deg.

        Position and rotation are over the workspace, flat and xy at joints `touched` (M, n).
        """
        poses = sample_workspace(self.robot, 60, seed=99)
        errors, motions, turns = self._compared(result, self.joints(poses), poses)
        answer = {"position": _rms_without(errors, motions)}
        if turns is not None:
            answer["rotation"] = _rms_without(*turns)
        if touched is not None:
            near = self.robot.kinematics.forward(touched).values_or_raise()
            errors, motions, _ = self._compared(result, touched, near)
            answer["flat"] = _rms_without(errors[:, 2:], motions[:, 2:][..., [0, 1, 5]])
            answer["xy"] = _rms_without(errors[:, :2], motions[:, :2][..., [2, 3, 4]])
        return answer

    def _compared(
        self, result: IdentificationResult, joints: Array, near: Array
    ) -> tuple[Array, Array, tuple[Array, Array] | None]:
        """Return errors (M, 3) and motions of the frame, and turns with motions if it turns."""
        nominal = self.robot.kinematics
        model = nominal.of(nominal.mechanism, result.value.flat())
        mechanism = model.mechanism.seen_from(None)
        at = mechanism.assemble(model.p, joints, near, np.zeros(joints.shape))
        real = self.truth.stood(joints, near)
        motions = frame_columns(at.poses[:, :3])
        errors = at.poses[:, :3] - real.places
        if len(mechanism.task) == 3:
            return errors, motions, None
        turned = mechanism.tool_axes(at.unknowns) @ real.axes.swapaxes(1, 2)
        vectors = np.degrees(Rotation.from_matrix(turned).as_rotvec())
        free = np.concatenate([np.tile(np.eye(3), (len(joints), 1, 1)), real.axes], axis=2)
        return errors, motions, (vectors, free)


BY_TRACKER = {"reflector", "reflectors", "span", "probe"}
STATED_MM: dict[str, float | tuple[float, ...]] = {
    "reflector": POINT_MM,
    "reflectors": POINT_MM,
    "span": 2.0**0.5 * POINT_MM,
    "probe": (POINT_MM,) * 3 + (TURN_LEVER_MM * TURN_STD_RAD,) * 3,
    "inclinometer": TURN_LEVER_MM * TURN_STD_RAD,
}


def _rms_without(errors: Array, motions: Array) -> float:
    """Return the rms length of errors (M, r) less the motions (M, r, k) that explain most."""
    columns, flat = motions.reshape(errors.size, -1), errors.ravel()
    beyond = flat - columns @ np.linalg.lstsq(columns, flat, rcond=None)[0]
    return float(np.sqrt((beyond**2).sum() / len(errors)))
