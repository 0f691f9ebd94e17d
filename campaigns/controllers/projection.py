"""Projection: the parameters that a controller knows which come nearest to an identified robot.

At the joints that the identified model has all over the workspace the controller's model puts the
plate somewhere else. Its parameters are those of the least mean square error of position, after the
best fit of the controller's frame, which its user may place as he likes (model.md, family).
"""

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import IdentificationRefused
from campaigns.fit.rigid_transforms import fit_transform
from campaigns.fit.uncertainty import without_frame
from campaigns.kinematics.mechanism import Kinematics

LEAST_SHARE = 0.9
"""Share of the workspace that the identified robot must be able to take."""
ROUNDS = 20
SETTLED_MM = 1e-10
"""Largest change of a position that ends the search."""


def position_errors(controller: Kinematics, identified: Kinematics, poses: Array) -> Array:
    """Return sizes (M,), mm, of what is left where a controller makes joints of poses (N, t).

    Joints come from all combinations of sides in turn; the frame is best fitted. Poses that the
    controller's kinematics does not reach are passed over.
    """
    from_above = np.arange(len(poses))[:, None] >> np.arange(len(identified.mechanism.joints)) & 1
    approach = np.where(from_above, 1.0, -1.0)
    joints = controller.inverse(poses, approach)
    wanted = poses[joints.is_solved]
    reached = identified.forward(
        joints.values[joints.is_solved], wanted, approach[joints.is_solved]
    )
    points, targets = reached.values[reached.is_solved, :3], wanted[reached.is_solved, :3]
    errors = fit_transform(points, targets).apply(points) - targets
    return np.asarray(np.linalg.norm(errors, axis=1))


def project_plain(identified: Kinematics, poses: Array) -> Kinematics:
    """Return the nearest parameters of those that every controller has; the others are 0.

    Parameters that only place the base frame, and the directions of arms and rails, stay as they
    were identified: an upright rail that leans a little aside would be one of another azimuth, by
    any angle. Raises `IdentificationRefused` when either robot cannot take the joints.
    """
    mechanism = identified.mechanism
    solution = identified.inverse(poses)
    if solution.is_solved.sum() < LEAST_SHARE * len(poses):
        raise IdentificationRefused(
            f"the identified robot can take {solution.is_solved.sum()} of {len(poses)} poses of "
            f"the workspace (limit {100.0 * LEAST_SHARE:g} %)",
            remedy="correct limits in robot.yaml or `space` in campaign.yaml",
        )
    joints, poses = solution.values[solution.is_solved], poses[solution.is_solved]
    p = identified.p.copy()
    p[len(mechanism.parameters.names) :] = 0.0
    free = mechanism.parameters.places(mechanism.free_by_paper)
    # Gauss-Newton: the errors are small, so a few rounds end it.
    for _ in range(ROUNDS):
        controller = Kinematics(mechanism, p)
        reached = controller.forward(joints, poses)
        if not reached.is_solved.all():
            raise IdentificationRefused(
                "the controller's kinematics cannot be assembled all over the workspace",
                remedy="correct targets with `pkmcal correct DIR --poses FILE` instead",
            )
        frame = fit_transform(reached.values[:, :3], poses[:, :3])
        errors = frame.apply(reached.values[:, :3]) - poses[:, :3]
        by_values = frame.rotation @ controller.jacobian(joints, reached.values)[:, :3, free]
        rows = without_frame(by_values, poses[:, :3] + errors).reshape(errors.size, -1)
        step = np.linalg.lstsq(rows, -errors.ravel())[0]
        p = p.copy()
        p[free] += step
        if np.abs(rows @ step).max() < SETTLED_MM:
            break
    return Kinematics(mechanism, p)
