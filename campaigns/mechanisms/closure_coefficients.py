"""Closures of any mechanism as numbers: what compiled loops need to know of it.

Its forearms' ends are combinations of a few functions: the upper ones of 1, cos q, sin q of a
crank's angle, or of 1, q, q² of a carriage's place; the lower ones, seen from the measured point,
of 1, θ, cos θ, sin θ of the platform's turn. The coefficients of these, and their derivatives, are
read off the mechanism at as many joints and turns, so that its mathematics is written once.
"""

from functools import lru_cache
from typing import TypeAlias

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.mechanisms.closed_chain import ClosedChain
from campaigns.mechanisms.configuration import COORDINATES, FOREARM
from campaigns.mechanisms.mechanism import Kinematics

SAMPLE_ANGLES, SAMPLE_WAYS = (0.0, 0.5 * np.pi, np.pi), (0.0, 1000.0, 2000.0)
"""Joints at which upper ends are read off, rad or mm."""
SAMPLE_TURNS = (-1.0, 0.0, 1.0, 2.0)
ELSEWHERE_RAD, ELSEWHERE_MM = 0.3, 300.0
"""Joint and turn at which the combinations are tried."""
SAME_MM = 1e-9

Closures: TypeAlias = tuple[Array, ...]
"""Of R robots: coefficients of upper ends (R, n, 3, 3), forearms' lengths (R, n), coefficients of
lower ends (R, n, 3, 4), levers that turn an angle into a way (R,), the limit of the turn (R,),
signs of the assembly mode (R,), derivatives of the upper ends by F parameters (R, F, 3, 3), and the
forearm's length for each of these that is one, else 0, (R, F)."""


def joint_functions(mechanism: ClosedChain, joints: Array) -> Array:
    """Functions of joints (N, n) of which upper ends are combinations, (3, n, N)."""
    q = np.ascontiguousarray(joints.T)
    if mechanism.joints[0].is_revolute:
        return np.array([np.ones_like(q), np.cos(q), np.sin(q)])
    way = q / SAMPLE_WAYS[1]
    return np.array([np.ones_like(q), way, way * way])


def joint_slopes(mechanism: ClosedChain, joints: Array) -> Array:
    """Derivatives by the joints of all of these but the constant, (2, n, N)."""
    q = np.ascontiguousarray(joints.T)
    if mechanism.joints[0].is_revolute:
        return np.array([-np.sin(q), np.cos(q)])
    return np.array([np.ones_like(q), 2.0 * q / SAMPLE_WAYS[1]]) / SAMPLE_WAYS[1]


def turn_functions(turns: Array) -> Array:
    """Functions of turns (N,) of which lower ends are combinations, (4, N)."""
    return np.array([np.ones_like(turns), turns, np.cos(turns), np.sin(turns)])


def owners(mechanism: ClosedChain, places: Index) -> tuple[Index, Index]:
    """Arm of each parameter, and its field, (F,); of the platform's -1, -2, … by field, and 0."""
    fields, arms = len(mechanism.parameters.arm_fields), len(mechanism.joints)
    own, beyond = places < arms * fields, arms * fields - 1 - places
    return np.where(own, places // fields, beyond), np.where(own, places % fields, 0)


def ends_by_platform(mechanism: ClosedChain, p: Array) -> Array:
    """Derivatives of the coefficients of lower ends by the platform's fields, (f, n, 3, 4)."""
    turns, arms = np.array(SAMPLE_TURNS), len(mechanism.joints)
    fields = len(mechanism.parameters.names) - arms * len(mechanism.parameters.arm_fields)
    if len(mechanism.task) == COORDINATES:
        return np.zeros((fields, arms, COORDINATES, len(turns)))
    poses = np.zeros((len(turns), len(mechanism.task)))
    poses[:, COORDINATES] = turns
    values = p[arms * len(mechanism.parameters.arm_fields) : len(mechanism.parameters.names)]
    columns = mechanism.platform.joints_by_fields(values, poses).swapaxes(1, 2)
    return np.ascontiguousarray(columns @ np.linalg.inv(turn_functions(turns)))


def closures(mechanism: ClosedChain, p: Array, places: Index, by_platform: Array) -> Closures:
    """Closures of level robots (G, R), with derivatives by these parameters, (F,)."""
    space, robots, arms = mechanism.parameters, p.shape[1], len(mechanism.joints)
    fields = len(space.arm_fields)
    joints, inverse = _sampled(mechanism)
    at_samples = mechanism.arms_at(p, np.tile(joints, (robots, 1)))
    upper = at_samples.elbows_mm.reshape(COORDINATES, arms, robots, -1) @ inverse
    lengths = p[: arms * fields].reshape(arms, fields, robots)[:, FOREARM]
    values = p[arms * fields : len(space.names)]
    scale = mechanism.platform.turn_scale(values, lengths)
    along = np.eye(COORDINATES)[:, :, None, None]
    along = np.broadcast_to(along, (COORDINATES, *at_samples.elbows_mm.shape))
    owner, field = owners(mechanism, places)
    has_azimuths = bool(np.isin(places, mechanism.azimuths).any())
    by_fields = at_samples.by_fields(along, azimuths=has_azimuths)[:, owner, field]
    shape = (COORDINATES, len(places), robots, len(joints))
    columns = by_fields.reshape(shape) @ (-0.5 * inverse)
    is_length = (owner >= 0) & (field == FOREARM)
    columns[:, (owner < 0) | is_length] = 0.0
    return (
        np.ascontiguousarray(upper.transpose(2, 1, 0, 3)),
        np.ascontiguousarray(lengths.T),
        np.ascontiguousarray(np.tensordot(values.T, by_platform, 1)),
        np.broadcast_to(scale.lever_mm, robots).astype(np.float64),
        np.full(robots, scale.limit_rad),
        mechanism.assembly_sign(p).astype(np.float64),
        np.ascontiguousarray(columns.transpose(2, 1, 0, 3)),
        np.ascontiguousarray(lengths[owner].T * is_length),
    )


@lru_cache(maxsize=8)
def _sampled(mechanism: ClosedChain) -> tuple[Array, Array]:
    """Joints (3, n) where upper ends are read off, and what makes coefficients of them, (3, 3)."""
    samples = np.array(SAMPLE_ANGLES if mechanism.joints[0].is_revolute else SAMPLE_WAYS)
    joints = np.repeat(samples[:, None], len(mechanism.joints), axis=1)
    return joints, np.asarray(np.linalg.inv(joint_functions(mechanism, joints)[:, 0]))


def are_combinations(robot: Kinematics) -> bool:
    """Whether a robot's forearms end where these combinations of functions say, elsewhere too."""
    mechanism, p, none = robot.mechanism, robot.p, np.zeros(0, dtype=np.intp)
    upper, _, lower, *_ = closures(mechanism, p[:, None], none, ends_by_platform(mechanism, p))
    elsewhere = ELSEWHERE_RAD if mechanism.joints[0].is_revolute else ELSEWHERE_MM
    joints = np.full((1, len(mechanism.joints)), elsewhere)
    pose = np.zeros((1, len(mechanism.task)))
    pose[:, COORDINATES:] = ELSEWHERE_RAD
    configuration = mechanism.configuration(p, joints)
    functions = joint_functions(mechanism, joints)[:, :, 0]
    upper_mm = np.einsum("nck,kn->cn", upper[0], functions)
    lower_mm = lower[0] @ turn_functions(np.array([ELSEWHERE_RAD]))[:, 0]
    upper_off_mm = upper_mm - configuration.arms.elbows_mm[:, :, 0]
    lower_off_mm = lower_mm - mechanism.platform.joints_mm(configuration.platform[:, 0], pose)[0]
    return bool(max(np.abs(upper_off_mm).max(), np.abs(lower_off_mm).max()) < SAME_MM)
