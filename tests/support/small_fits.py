"""Small fits: of drawn linear models, for algebra, and of robots whose truth is drawn."""

from dataclasses import replace

import numpy as np

from campaigns.design.pose_sampling import workspace_poses
from campaigns.fit.error_model import ErrorModel, Observations, Prediction
from campaigns.fit.fit import Fit, Prior
from campaigns.fit.rigid_transforms import Transform, from_paper_angles
from campaigns.robots.robot import find_robot

FRAME = from_paper_angles(np.array([0.02, -0.03, 2.1]), np.array([2500.0, 400.0, 300.0]))
STATED_MM = 0.01
SHIPPED = {"par4": "par4-prototype"}
NO_FRAME = Transform(np.eye(3), np.zeros(3))


def model_of(name="delta", *groups, effects=(), **settings):
    """Model of a shipped robot in which only these groups are unknown; all without any."""
    nominal = find_robot(name).robot.kinematics
    whole = ErrorModel(nominal)
    free = {n for n, group in zip(whole.names, whole.groups, strict=True) if group in groups}
    held = frozenset(whole.names) - free if groups else frozenset()
    return ErrorModel(nominal, held=held, effects=effects, **settings)


def observed(model, shots=24, *, seed=1, x=None, noise_mm=STATED_MM, sessions=1, change=None):
    """Observations of the robot at `x` in tolerances; `change` moves joints or parts of them.

    `change` returns the x (P,) and joints (n,) of a shot, given its row and its joints.
    """
    rng = np.random.default_rng(seed)
    nominal = model.nominal
    robot = find_robot(SHIPPED.get(nominal.mechanism.name, nominal.mechanism.name)).robot
    poses = workspace_poses(nominal, robot.limits, robot.workspace_centre, shots, rng)
    joints = nominal.inverse(poses).values_or_raise()
    x = np.zeros(len(model.names)) if x is None else x
    rows = [(x, joint) if change is None else change(n, x, joint) for n, joint in enumerate(joints)]
    positions = np.array(
        [
            model.kinematics(of_shot).forward(joint[None], pose[None]).values_or_raise()[0, :3]
            for (of_shot, joint), pose in zip(rows, poses, strict=True)
        ]
    )
    frame = np.arange(shots) * sessions // shots
    shift = np.array([[100.0, -50.0, 20.0]]) * frame[:, None]
    points = FRAME.apply(positions) + shift + noise_mm * rng.standard_normal((shots, 3))
    stated = np.broadcast_to(STATED_MM**2 * np.eye(3), (shots, 3, 3))
    moment = np.arange(float(shots))
    return Observations(
        joints=joints,
        approach=np.zeros_like(joints),
        near=poses,
        points=points,
        noise={"stated": stated},
        frame=frame,
        warmth=np.zeros(shots),
        moment=moment,
        time=moment / (shots - 1.0),
        former=np.concatenate([joints[:1], joints[:-1]]),
    )


def with_points(observations, points):
    return replace(observations, points=points)


GROUPS = ("offsets", "axes", "sag", "scale")
"""Of a delta robot: 4 unknowns with their tolerance, a group of 3 and one of 4 that are learned."""


def drawn_fit(seed=1, shots=20, *, groups=GROUPS, effects=(), prior=None, good=None, at_zero=False):
    """Fit of drawn residuals and derivatives, with the names and groups of a delta robot.

    Residuals are those of drawn unknowns, with noise of 0.5 mm; the frame's columns are drawn, too.
    """
    rng = np.random.default_rng(seed)
    model = model_of("delta", *groups, effects=effects)
    size = model.size + 6
    jacobian = rng.normal(size=(shots, 3, size))
    unknowns = 2.0 * rng.normal(size=size)
    residual = -jacobian @ unknowns + 0.5 * rng.normal(size=(shots, 3))
    root = rng.normal(size=(shots, 3, 3))
    noise = {
        "stated": 0.01 * (root @ root.swapaxes(1, 2) + np.eye(3)),
        "points": np.broadcast_to(0.25 * np.eye(3), (shots, 3, 3)),
        "joints": 0.1 * root[:, ::-1] @ root[:, ::-1].swapaxes(1, 2) + 0.01 * np.eye(3),
    }
    x = np.zeros(model.size) if at_zero else 0.3 * rng.normal(size=model.size)
    joints = rng.normal(size=(shots, 3))
    moment = np.arange(float(shots))
    observations = Observations(
        joints=joints, approach=0.0 * joints, near=joints, points=joints,
        noise={"stated": noise["stated"]}, frame=np.zeros(shots, dtype=int),
        warmth=np.zeros(shots), moment=moment, time=moment / shots, former=joints,
    )  # fmt: skip
    at = Prediction(x, (NO_FRAME,), None, residual, jacobian, {})
    return Fit(
        model, observations, prior or Prior(), at, noise, np.ones(shots, dtype=bool),
        np.ones(shots) if good is None else good, dict.fromkeys(model.sized_groups, 1.0),
        {"stated": 1.0, "points": 1.0, "joints": 1.0},
    )  # fmt: skip


def at_minimum(fit):
    """The drawn fit after its step, in its linear model."""
    x = fit.at.x + fit.step[: fit.model.size]
    return replace(fit, at=replace(fit.at, x=x, residual=fit.residual))


def dense(fit):
    """Derivatives (3N, Q), residuals (3N,), covariance (3N, 3N) of all kept shots."""
    rows = np.flatnonzero(fit.good > 0.0)
    jacobian = fit.at.jacobian[rows]
    covariance = np.zeros((3 * len(rows), 3 * len(rows)))
    for number, row in enumerate(rows):
        place = slice(3 * number, 3 * number + 3)
        of_shot = sum(fit.factors[part] * noise[row] for part, noise in fit.noise.items())
        covariance[place, place] = of_shot / fit.good[row]
    return jacobian.reshape(-1, jacobian.shape[2]), fit.at.residual[rows].ravel(), covariance


def log_marginal(fit, sizes=None):
    """Log density of the data without what frames may be, by their whole covariance matrix.

    The prior's precision of unknowns is diagonal; data are moved to where the prior's mean is.
    """
    sizes = sizes or fit.sizes
    rows, residual, covariance = dense(fit)
    precision, deviation = fit.prior_terms
    prior = np.diag(precision).copy()
    for group, places in fit.groups.items():
        prior[places] = sizes[group] ** -2
    size = fit.model.size
    by = rows[:, :size]
    covariance = covariance + by / prior[:size] @ by.T
    data = residual - by @ deviation[:size]
    outside = np.linalg.svd(rows[:, size:])[0][:, rows.shape[1] - size :]
    covariance, data = outside.T @ covariance @ outside, outside.T @ data
    return -0.5 * (np.linalg.slogdet(covariance)[1] + data @ np.linalg.solve(covariance, data))


def with_columns(fit, effect, columns=None):
    """The fit with an effect more, at unknowns 0 of it, in the same linear model."""
    columns = fit.at.columns_of(effect, fit.observations) if columns is None else columns
    size = fit.model.size
    jacobian = fit.at.jacobian
    jacobian = np.concatenate([jacobian[..., :size], columns, jacobian[..., size:]], axis=2)
    at = replace(fit.at, x=np.r_[fit.at.x, np.zeros(effect.count)], jacobian=jacobian)
    model = fit.model.with_effects((*fit.model.effects, effect))
    return replace(fit, model=model, at=at)


def log_bayes_factor(fit, effect, sizes):
    """Exact log Bayes factor of an effect whose groups have these sizes, in the linear model."""
    return log_marginal(with_columns(fit, effect), {**fit.sizes, **sizes}) - log_marginal(fit)
