"""Datum (gauge) transformation: the same robot, its base frame placed by other parameters.

Points measured in a frame of their own tell nothing along the null space of the workspace Jacobian
with a free frame beside it. Along it a robot is moved until what fixes the datum is as wanted: the
S-transformation of geodesy, in Gauss-Newton steps because robots are not linear.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.estimation.rigid_transforms import fit_transform, frame_jacobian
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.parameters import Role

SAMPLE = 30
"""Joints at which points are compared."""
SPREAD = 0.5
"""Of them, rad of a crank or what compares with it, about 0."""
ROUNDS = 20
SETTLED = 1e-10
"""Last step, rad or mm: the next one is some thousandth of it."""
SAME_MM = 1e-9
"""Points nearer than that are the same."""


@dataclass(frozen=True, eq=False)
class DatumSample:
    """Joints where robots like this one can be assembled, found when they are asked for."""

    robot: Kinematics

    @cached_property
    def joints_and_poses(self) -> tuple[Array, Array]:
        """Joints (N, n) at which points are compared, and this robot's poses (N, t) there."""
        scale = SPREAD * np.array([axis.scale for axis in self.robot.mechanism.joints])
        joints = scale * np.random.default_rng(1).uniform(-1.0, 1.0, (SAMPLE, len(scale)))
        solved = self.robot.forward(joints)
        return joints[solved.found], solved.values[solved.found]


def datum_parameters(
    nominal: Kinematics, own: Kinematics, sample: DatumSample | None = None
) -> Kinematics:
    """Robot of the same points, but for their frame, whose datum's parameters are the nominal's.

    Exact, but for plate bars that follow the azimuths of tilted arms and for carriages' plates that
    tilt instead of the base: what is left there is of second order in the tilts. Who asks for many
    robots gives them one sample, of the nominal one.
    """
    space, mechanism = own.mechanism.parameters, own.mechanism
    wanted = own.p.copy()
    held = space.places([name for name in space.datum if name in space.geometry])
    if (wanted[held] == nominal.p[held]).all():
        return own
    wanted[held] = nominal.p[held]
    joints, near = (sample or DatumSample(nominal)).joints_and_poses
    solved = own.forward(joints, near)
    joints, poses = joints[solved.found], solved.values[solved.found]
    told = [space[name] for name in space.geometry if not space[name].fixes_datum]
    free = space.places([each.name for each in told])
    level = space.places([each.name for each in told if each.role is not Role.EXTENSION])
    if not wanted[space.places(space.extensions)].any():
        moved, left_mm = _moved(Kinematics(mechanism, wanted), level, joints, poses)
        if left_mm < SAME_MM:
            return moved
    return _moved(Kinematics(mechanism, wanted), free, joints, poses)[0]


def _moved(
    robot: Kinematics, free: Index, joints: Array, wanted: Array
) -> tuple[Kinematics, float]:
    """Robot whose points at joints (N, n) come nearest to those wanted (N, t), and how near."""
    seen, by_frame = wanted, frame_jacobian(wanted[:, :3])
    for _ in range(ROUNDS):
        seen = robot.forward(joints, seen).values_or_raise()
        points = seen[:, :3]
        frame = fit_transform(points, wanted[:, :3])
        error = frame.apply(points) - wanted[:, :3]
        by_parameters = robot.jacobian(joints, seen)[:, :3, free]
        columns = np.concatenate([frame.rotation @ by_parameters, by_frame], axis=2)
        rows = columns.reshape(-1, columns.shape[2])
        size = np.linalg.norm(rows, axis=0)
        step = np.linalg.lstsq(rows / size, -error.ravel(), rcond=1e-10)[0] / size
        if not np.abs(step[: len(free)]).max() > SETTLED:
            break
        p = robot.p.copy()
        p[free] += step[: len(free)]
        robot = Kinematics(robot.mechanism, p)
    return robot, float(np.abs(error).max())
