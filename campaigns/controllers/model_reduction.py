"""Projection: the few parameters of a controller that come nearest to an identified robot.

At the joints that the identified model has all over the workspace the controller's model puts the
plate somewhere else. Its parameters are those of the least mean square error of position, after the
best fit of the controller's frame, which its user may place as he likes (model.md, family).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from campaigns.arrays import Array
from campaigns.errors import IdentificationRefused
from campaigns.estimation.information import LEAST_SHARE
from campaigns.estimation.observability import project_out_nuisance
from campaigns.estimation.rigid_transforms import Transform, fit_transform, frame_jacobian
from campaigns.mechanisms.closed_chain import ClosedChain
from campaigns.mechanisms.mechanism import Kinematics, NoSolution

CONVERGED = 1e-14
"""Relative change of the sum of squares and of the parameters at which the search ends."""
STEP = 1e-4
"""Of a controller's value, mm or rad, by which a robot is differentiated: robots are smooth."""
THIRD = 2.0 * np.pi / 3.0
ARMS = 3
CANNOT_FOLLOW = "correct targets with `pkmcal correct` instead"


@dataclass(frozen=True, slots=True)
class ResidualError:
    """Error of position over the workspace that one set of parameters leaves, mm."""

    mean_mm: float
    max_mm: float
    rms_mm: float | None = None

    @classmethod
    def of(cls, errors: Array) -> "ResidualError":
        """From errors (N, 3)."""
        size = np.linalg.norm(errors, axis=1)
        rms = float(np.sqrt(np.mean(size**2)))
        return cls(float(size.mean()), float(size.max()), rms)


@dataclass(frozen=True, slots=True, eq=False)
class ModelReduction:
    """Values of a controller's parameters, and what they leave."""

    values: Array
    """(C,), mm and rad."""
    kinematics: Kinematics
    base_from_controller: Transform
    error: ResidualError


@dataclass(frozen=True, slots=True, eq=False)
class Workspace:
    """Joints (N, n) all over the workspace, and the poses (N, t) that the identified robot has."""

    joints: Array
    poses: Array

    @classmethod
    def of(cls, identified: Kinematics, poses: Array) -> "Workspace":
        """From those of the poses that the identified robot can take.

        Raises `IdentificationRefused` where these are too few.
        """
        joints = identified.inverse(poses)
        if joints.found.sum() < LEAST_SHARE * len(poses):
            raise IdentificationRefused(
                f"the identified robot can take {joints.found.sum()} of {len(poses)} poses of the "
                f"workspace (limit {100.0 * LEAST_SHARE:g} %)",
                remedy="correct limits in robot.yaml or `space` in campaign.yaml",
            )
        return cls(joints.values[joints.found], poses[joints.found])


def left_by(kinematics: Kinematics, workspace: Workspace) -> ResidualError:
    """What other parameters leave of position over a workspace, the frame best fitted.

    Raises `IdentificationRefused` when a robot of these parameters cannot take the joints.
    """
    return ResidualError.of(_fitted(kinematics, workspace)[2])


def left_as_commanded(
    controller: Kinematics,
    identified: Kinematics,
    poses: Array,
    approach: Array,
    readings: Callable[[Array, Array], Array] = lambda joints, _: joints,
) -> ResidualError:
    """What is left where a controller makes joints of poses (N, t), the frame best fitted.

    Joints come by `approach` (N, n); `readings` are the encoders' that the controller's axes make
    of its joints. Poses that its kinematics does not reach are passed over.
    """
    joints = controller.inverse(poses, approach)
    some, sides = poses[joints.found], approach[joints.found]
    reached = identified.forward(readings(joints.values[joints.found], sides), some, sides)
    wanted, there = some[reached.found, :3], reached.values[reached.found, :3]
    return ResidualError.of(fit_transform(there, wanted).apply(there) - wanted)


def project_plain(identified: Kinematics, workspace: Workspace) -> ModelReduction:
    """Nearest parameters of those that every controller knows; the others are 0, held ones stay."""
    space, fixed = identified.mechanism.parameters, identified.p.copy()
    fixed[len(space.names) :] = 0.0
    places = space.places(space.free_by_default)

    def vector(values: Array) -> Array:
        p = fixed.copy()
        p[places] = values
        return p

    return project(identified.mechanism, vector, fixed[places], workspace)


def project(
    mechanism: ClosedChain, vector: Callable[[Array], Array], start: Array, workspace: Workspace
) -> ModelReduction:
    """Values (C,) that leave the least mean square error of position, from those at `start`.

    `vector` makes the robot's parameters (P,) of them. Raises `IdentificationRefused` when the
    controller's robot cannot take the joints.
    """

    def told(values: Array) -> Kinematics:
        return Kinematics(mechanism, vector(values))

    def jacobian(values: Array) -> Array:
        robot = told(values)
        poses, frame, errors = _fitted(robot, workspace)
        own = robot.jacobian(workspace.joints, poses)
        by_values = frame.rotation @ own[:, :3] @ _by_values(vector, values)
        points = workspace.poses[:, :3] + errors
        columns = np.concatenate([by_values, frame_jacobian(points)], axis=2)
        return project_out_nuisance(columns.reshape(-1, columns.shape[2]), len(values))

    def residual(values: Array) -> Array:
        return _fitted(told(values), workspace)[2].ravel()

    found = scipy.optimize.least_squares(
        residual, start, jac=jacobian, x_scale="jac", ftol=CONVERGED, xtol=CONVERGED, gtol=CONVERGED
    )
    kinematics = told(found.x)
    _, frame, errors = _fitted(kinematics, workspace)
    return ModelReduction(found.x, kinematics, frame, ResidualError.of(errors))


def _fitted(kinematics: Kinematics, workspace: Workspace) -> tuple[Array, Transform, Array]:
    """Poses (N, t) by other parameters, their best frame, and errors (N, 3) of them in it."""
    try:
        poses = kinematics.forward(workspace.joints, workspace.poses).values_or_raise()
    except NoSolution as error:
        raise IdentificationRefused(
            f"the controller's kinematics cannot be assembled all over the workspace: {error}",
            remedy=CANNOT_FOLLOW,
        ) from error
    frame = fit_transform(poses[:, :3], workspace.poses[:, :3])
    return poses, frame, frame.apply(poses[:, :3]) - workspace.poses[:, :3]


def _by_values(vector: Callable[[Array], Array], values: Array) -> Array:
    """∂p/∂values, (P, C), by central differences."""
    steps = STEP * np.eye(len(values))
    return np.column_stack(
        [(vector(values + step) - vector(values - step)) / (2.0 * STEP) for step in steps]
    )


@dataclass(frozen=True, slots=True, eq=False)
class SymmetricDelta:
    """Delta or linear Delta with arms of one radius about the vertical, a third of a turn apart.

    Values: the radius; lengths of arms (rotary only) and of forearms, one for all or one each; the
    second and third arm's direction, if it may be told; joint offsets, if they may be. All arms are
    at one height: of carriages the first offset is the frame's height, and stays 0.
    """

    mechanism: ClosedChain
    azimuths: Array
    """Of the arms about the vertical, (3,), the first one being the frame's."""
    per_arm: bool
    angles_free: bool
    offsets_free: bool
    typical: Array
    """Radius, arm and forearm to begin with, mm; the arm of carriages is 0."""

    @property
    def is_rotary(self) -> bool:
        """Whether cranks drive it."""
        return self.mechanism.joints[0].is_revolute

    @property
    def columns(self) -> tuple[tuple[str, int | None], ...]:
        """Kind of each value and the arm that it is of; None: of all."""
        each: Sequence[int | None] = range(ARMS) if self.per_arm else (None,)
        kinds: list[tuple[str, int | None]] = [("radius", None)]
        if self.is_rotary:
            kinds += [("arm", arm) for arm in each]
        kinds += [("forearm", arm) for arm in each]
        if self.angles_free:
            kinds += [("angle", arm) for arm in (1, 2)]
        if self.offsets_free:
            kinds += [("offset", arm) for arm in (range(ARMS) if self.is_rotary else (1, 2))]
        return tuple(kinds)

    @property
    def start(self) -> Array:
        """Typical lengths, no offsets, arms a third of a turn apart."""
        own = dict(zip(("radius", "arm", "forearm"), self.typical.tolist(), strict=True))
        return np.array([own.get(kind, 0.0) for kind, _ in self.columns])

    def of_arms(self, values: Array, kind: str) -> Array:
        """Values of a kind by arm, (3,); 0 where there are none."""
        found = np.zeros(ARMS)
        for (each, arm), value in zip(self.columns, values.tolist(), strict=True):
            if each == kind:
                found[slice(None) if arm is None else arm] = value
        return found

    def vector(self, values: Array) -> Array:
        """Parameters of the robot."""
        angle = self.azimuths + self.of_arms(values, "angle")
        radius = self.of_arms(values, "radius")
        by_stem = {
            "x": radius * np.cos(angle),
            "y": radius * np.sin(angle),
            "azimuth": angle,
            "joint_offset": self.of_arms(values, "offset"),
            "arm": self.of_arms(values, "arm"),
            "elevation": np.full(ARMS, 0.5 * np.pi),
            "forearm": self.of_arms(values, "forearm"),
        }
        space = self.mechanism.parameters
        p = np.zeros(len(space.of_robot))
        for field in space.arm_fields:
            p[space.places(space.of_field(field.name))] = by_stem.get(field.stem, 0.0)
        return p


def symmetric_delta(
    nominal: Kinematics, *, per_arm: bool, angles_free: bool, offsets_free: bool
) -> SymmetricDelta:
    """Symmetrical robot nearest to a nominal one by eye, to begin with."""
    space, p = nominal.mechanism.parameters, nominal.p

    def of_arms(field: str) -> Array:
        return p[space.places(space.of_field(field))]

    x, y = of_arms("x_mm"), of_arms("y_mm")
    arms_mm = of_arms("arm_mm")
    rotary = bool(arms_mm.size)
    first = float(of_arms("azimuth_deg")[0]) if rotary else float(np.arctan2(y[0], x[0]))
    way = np.sign(np.sin(np.arctan2(y[1], x[1]) - np.arctan2(y[0], x[0])))
    typical = [
        float(np.hypot(x, y).mean()),
        float(arms_mm.mean()) if rotary else 0.0,
        float(of_arms("forearm_mm").mean()),
    ]
    return SymmetricDelta(
        nominal.mechanism,
        first + way * THIRD * np.arange(ARMS),
        per_arm,
        angles_free,
        offsets_free,
        np.array(typical),
    )
