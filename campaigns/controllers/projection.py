"""Projection: the plain parameters of a controller that come nearest to an identified robot."""

# Few controllers have the tilts, skews and gear errors that an identification also finds. Plain
# parameters (lengths, places, joint offsets) can take over a part of their effect: the projection
# takes the joints of the identified model at poses all over the workspace, and minimises the mean
# square of the position errors that the plain model has at these joints.
# The controller's base frame may be placed freely by its user. So each error is taken after the
# best rigid fit of the two sets of points, and the derivatives have every motion of the frame
# removed: otherwise parameters would be spent on imitating a shift of the frame.

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import IdentificationRefused
from campaigns.fit.rigid_transforms import fit_transform
from campaigns.fit.uncertainty import without_frame
from campaigns.kinematics.model import Kinematics

LEAST_SHARE = 0.9
"""Share of the workspace's poses that the identified robot must be able to take."""
MOST_ROUNDS = 20
SETTLED_MM = 1e-10
"""Largest change of a position that ends the search."""


def position_errors(controller: Kinematics, identified: Kinematics, poses: Array) -> Array:
    """Return the sizes (M,), mm, of the position errors of a robot commanded to poses (N, t).

    The controller computes joints by its own model, and the identified model says where the robot
    then is; the frame is best fitted. Poses that either model cannot take are left out: M ≤ N.
    """
    # The robot's backlash acts by the direction from which each joint arrives. Row i takes the
    # bits of i as directions, so that all combinations occur equally often.
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
    """Return the model of plain parameters that is nearest to the identified one.

    `poses` (N, t) are spread over the workspace. All optional parameters are 0. Raise
    `IdentificationRefused` for a mechanism whose plain form is not known, if the identified robot
    can take too few of the poses, or if the plain model cannot be assembled at its joints.
    """
    mechanism = identified.mechanism
    if not mechanism.has_forearms:
        raise IdentificationRefused(
            f"which parameters a plain controller of a {mechanism.name} has is not known",
            remedy="export without --format, or correct targets with `pkmcal correct`",
        )
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
    # Held as identified: parameters that only place the base frame, and the directions of arms and
    # rails. The azimuth of an upright rail that leans a little would be fitted to any angle.
    free = mechanism.parameters.places(mechanism.free_by_paper)
    for _ in range(MOST_ROUNDS):
        controller = Kinematics(mechanism, p)
        reached = controller.forward(joints, poses)
        if not reached.is_solved.all():
            raise IdentificationRefused(
                "the controller's kinematics cannot be assembled all over the workspace",
                remedy="correct targets with `pkmcal correct DIR --poses FILE` instead",
            )
        frame = fit_transform(reached.values[:, :3], poses[:, :3])
        errors = frame.apply(reached.values[:, :3]) - poses[:, :3]
        # d(position)/d(free parameter) at fixed joints, (M, 3, F), turned into the fitted frame
        slopes = frame.rotation @ controller.jacobian(joints, reached.values)[:, :3, free]
        rows = without_frame(slopes, poses[:, :3] + errors).reshape(errors.size, -1)
        step = np.linalg.lstsq(rows, -errors.ravel())[0]
        p = p.copy()
        p[free] += step
        if np.abs(rows @ step).max() < SETTLED_MM:
            break
    return Kinematics(mechanism, p)
