"""Projection: the parameters that a controller knows which come nearest to an identified robot.

At the joints that the identified model has all over the workspace the controller's model puts the
plate somewhere else. Its parameters are those of the least mean square error of position, after the
best fit of the controller's frame, which its user may place as he likes (model.md, family).
"""

from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import IdentificationRefused
from campaigns.fit.rigid_transforms import Transform, fit_transform
from campaigns.fit.uncertainty import without_frame
from campaigns.kinematics.mechanism import Kinematics, NoSolution

LEAST_SHARE = 0.9
"""Share of the workspace that the identified robot must be able to take."""
ROUNDS = 20
SETTLED_MM = 1e-10
"""Largest change of a position that ends the search."""
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
    """Kinematics of a controller, and what it leaves."""

    kinematics: Kinematics
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


def left_as_commanded(
    controller: Kinematics, identified: Kinematics, poses: Array, approach: Array
) -> ResidualError:
    """What is left where a controller makes joints of poses (N, t), the frame best fitted.

    Joints come by `approach` (N, n). Poses that its kinematics does not reach are passed over.
    """
    joints = controller.inverse(poses, approach)
    some, sides = poses[joints.found], approach[joints.found]
    reached = identified.forward(joints.values[joints.found], some, sides)
    wanted, there = some[reached.found, :3], reached.values[reached.found, :3]
    return ResidualError.of(fit_transform(there, wanted).apply(there) - wanted)


def project_plain(identified: Kinematics, workspace: Workspace) -> ModelReduction:
    """Nearest parameters of those that every controller knows; the others are 0.

    They leave the least mean square error of position. Parameters that only place the base frame,
    and the directions of arms and rails, stay as they were identified: an upright rail that leans
    a little aside would be one of another azimuth, by any angle. Raises `IdentificationRefused`
    when the controller's robot cannot take the joints.
    """
    space, fixed = identified.mechanism.parameters, identified.p.copy()
    fixed[len(space.names) :] = 0.0
    places = space.places(identified.mechanism.free_by_paper)

    def controller(values: Array) -> Kinematics:
        p = fixed.copy()
        p[places] = values
        return Kinematics(identified.mechanism, p)

    # Gauss-Newton: the errors are small, so a few rounds end it.
    values = fixed[places]
    for _ in range(ROUNDS):
        robot = controller(values)
        poses, frame, errors = _fitted(robot, workspace)
        by_values = frame.rotation @ robot.jacobian(workspace.joints, poses)[:, :3, places]
        rows = without_frame(by_values, workspace.poses[:, :3] + errors).reshape(errors.size, -1)
        step = np.linalg.lstsq(rows, -errors.ravel())[0]
        values = values + step
        if np.abs(rows @ step).max() < SETTLED_MM:
            break
    kinematics = controller(values)
    return ModelReduction(kinematics, ResidualError.of(_fitted(kinematics, workspace)[2]))


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
