"""Uncertainty of positions over the workspace: its size, its budget, and where it holds.

Parameters are a means: what a user gets is where the robot stands. σ of a position follows from
the posterior covariance through the derivatives of that position by every unknown. Parameters with
large correlated σ may give small σ of positions, so this is the figure to judge a result by.
"""

from collections.abc import Collection, Mapping
from typing import Literal

import numpy as np

from campaigns.arrays import Array
from campaigns.evaluation.region import Region
from campaigns.fit.effects import Effect, Layer, Ripple
from campaigns.fit.error_model import Observations, RobotPoints
from campaigns.fit.error_sources import SOURCES, by_first_joint
from campaigns.fit.fit import Fit
from campaigns.fit.uncertainty import (
    FORMER,
    SIZES,
    budget,
    length_std,
    unseen_covariances,
    without_axes,
    without_frame,
)
from campaigns.identification.determined import (
    Determined,
    assumed_share,
    determined_on_planes,
    rotation_determined,
)
from campaigns.identification.result import ParameterCovariance, PositionStd, Share, Uncertainty
from campaigns.kinematics.model import Kinematics

FEWEST_POSES = 0.9
"""Share of the workspace's sample that the identified robot must be able to take."""
ESTIMATED = ("points", "joints", "along", "across", "repeating")
"""Parts of the noise that are estimated from the shots' scatter: type A. All else is type B."""
REPEATING = "repeating"
"""Row of the budget: scatter of the fit that visits of one pose do not show."""
NOISE_WORDS = {
    "stated": "tracker: noise of points, as stated",
    "along": "tracker: noise along the beam",
    "across": "tracker: noise across the beam",
    "points": "robot: scatter of its point",
    "joints": "robot: scatter of its joints",
    "changes": "changes during the campaign",
    "stand": "slow motion of the stand",
    "periods": "periodic errors of the drives",
    "lag": "joints read before they arrived",
    "surroundings": "planes, parts and holders that were measured",
    "layer": "errors by place or angle without a known source",
    REPEATING: "errors that repeat, beyond the scatter of visits",
    FORMER: "former result",
    SIZES: "sizes of the groups of errors",
}


def uncertainty_of_positions(
    fit: Fit,
    identified: Kinematics,
    workspace: Array,
    ratio: float,
    repeating: float = 0.0,
    *,
    tested: Collection[str] = (),
) -> Uncertainty:
    """Return the uncertainty of positions at poses (N, t), in the frame that fits all of them best.

    `ratio` multiplies the uncertainty where hold-out pairs showed larger errors, `repeating` is the
    share of the robot's scatter that repeats, and so is an error of each position. `tested` are the
    quantities that hold-out shots check. Rotation is stated beside positions, and heights and
    places on planes that were touched. Nothing is stated where the identified robot can take too
    few of the poses.
    """
    # 1. Derivatives of the positions by all unknowns, at the workspace's sample and at the shots
    #    that counted, both "unmeasured": without a tracker, since only the robot is asked about.
    # 2. Remove the part of the derivatives that is a motion of the whole frame: a robot that is
    #    shifted as a whole is placed right by the fit of its base, so that is no error.
    # 3. σ and budget over the sample alone. For the region of validity sample and shots share one
    #    frame instead, or their σ could not be compared.
    at_sample, sample = identified.select_reachable(workspace)
    if len(sample) < FEWEST_POSES * len(workspace):
        return Uncertainty()
    shots, count = fit.observations.rows(fit.kept), len(sample)
    both = Observations.unmeasured(
        np.vstack([at_sample, shots.joints]), np.vstack([sample, shots.near])
    )
    robot = fit.model.robot_at(fit.at.x, both, both.near)
    positions = robot.assembly.points
    if not robot.assembly.is_solved.all():
        return Uncertainty()
    covariance = fit.covariance[: fit.model.size, : fit.model.size]
    between_shots = unseen_covariances(fit, robot.by_moves, both).trace(axis1=1, axis2=2)
    (point, joint), axes = fit.scatter, fit.model.nominal.mechanism.joints
    by_joint2 = (by_first_joint(axes, robot.by_moves["joints"]) ** 2).sum(axis=(1, 2))
    repeats = repeating * (3.0 * point**2 + joint**2 * by_joint2)
    by_sample = without_frame(robot.by[:count], positions[:count])
    of_sample = length_std(by_sample, covariance)
    followed = ratio * np.sqrt(of_sample**2 + between_shots[:count] + repeats[:count])
    # What no parameter describes is an error of all who use the parameters alone. `correct` follows
    # layers, but no periods beyond the one of each joint in robot files.
    beyond, periods = (
        without_frame(_moved_by(fit, robot, kinds)[:count, :, None], positions[:count])
        for kinds in ((Layer, Ripple), (Ripple,))
    )
    std, of_corrected = (
        np.hypot(followed, ratio * np.linalg.norm(moved, axis=(1, 2)))
        for moved in (beyond, periods)
    )
    of_all = length_std(without_frame(robot.by, positions), covariance)
    of_both = np.sqrt(of_all**2 + between_shots + repeats)
    region = Region.of(sample, of_both[:count], of_both[count:], identified.mechanism.task)
    rms = float(np.sqrt((std**2).mean()))
    corrected = float(np.sqrt((of_corrected**2).mean())) if beyond.any() else None
    sizes = PositionStd(float(std.mean()), float(std.max()), rms, len(workspace) - count, corrected)
    squares = dict(budget(fit, by_sample))
    if beyond.any():
        further = float(between_shots[:count].mean() + (beyond**2).sum() / count)
        squares["layer"] = squares.get("layer", 0.0) + further
    if repeating:
        squares[REPEATING] = float(repeats[:count].mean())
    assumed = assumed_share(fit, squares)
    position = Determined(
        "position", sizes.mean, sizes.max, sizes.rms, assumed, "position" in tested
    )
    # points of one reflector do not check the tool's rotation
    rotation = rotation_determined(
        fit, identified, at_sample, sample, ratio, is_tested="rotation" in tested
    )
    on_planes = determined_on_planes(fit, tested)
    return Uncertainty(
        position_std_mm=sizes,
        budget=_shares(squares, ratio, rms),
        region=region,
        determined=(position, *rotation, *on_planes),
    )


def _moved_by(fit: Fit, robot: RobotPoints, kinds: tuple[type[Effect], ...]) -> Array:
    """Return how far effects of these kinds move points, (N, 3), mm."""
    moved = np.zeros_like(robot.by[..., 0])
    for effect, where in zip(fit.model.effects, fit.model.effect_places, strict=True):
        if isinstance(effect, kinds):
            moved += robot.by[..., where] @ fit.at.x[where]
    return moved


def std_of_positions(
    robot: Kinematics, covariance: ParameterCovariance, poses: Array, about: Array
) -> Array:
    """Return 1 σ of positions at poses (N, t), (N,), after the best fit of the frame.

    The frame is fitted to these and to the poses `about` (M, t), where the robot was measured.
    """
    # As above, from the stored covariance of the robot's parameters (mm, deg, ppm) instead of a
    # posterior. A frame fitted to a few poses alone would swallow most of their error.
    both = np.vstack([poses, about])
    joints = robot.inverse(both).values_or_raise()
    table = robot.mechanism.parameters
    places = table.places(covariance.names)
    by = robot.point_jacobian(joints, both)[..., places] * table.file_unit[places]
    std = length_std(without_frame(by, robot.points(both)), covariance.array)
    return covariance.hold_out_ratio * std[: len(poses)]


def std_of_rotations(
    robot: Kinematics, covariance: ParameterCovariance, poses: Array, about: Array
) -> Array:
    """Return 1 σ of the tool's rotation at poses (N, t), (N,), deg.

    Axes of base and tool are the best ones for these and for the poses `about` (M, t), where the
    robot was measured.
    """
    both = np.vstack([poses, about])
    joints = robot.inverse(both).values_or_raise()
    mechanism, table = robot.mechanism, robot.mechanism.parameters
    places = table.places(covariance.names)
    unknowns = mechanism.assemble(robot.p, joints, both).unknowns
    by = mechanism.turn_jacobian(robot.p, joints, unknowns)[..., places] * table.file_unit[places]
    by = without_axes(np.degrees(by), mechanism.tool_axes(both))
    return covariance.hold_out_ratio * length_std(by, covariance.array)[: len(poses)]


def _shares(squares: Mapping[str, float], ratio: float, rms: float) -> tuple[Share, ...]:
    """Return the budget's rows; errors beyond σ that hold-out pairs showed have a row of theirs."""
    # The rows' squares add up to rms², in which `ratio` is already: without it the rms would be
    # rms / ratio, so that the model's row is √(rms² − (rms / ratio)²).
    shares = []
    for source, square in squares.items():
        words = NOISE_WORDS.get(source) or SOURCES[source].words
        kind: Literal["A", "B"] = "A" if source in ESTIMATED else "B"
        shares.append(Share(source, words, kind, float(np.sqrt(max(square, 0.0)))))
    if ratio > 1.0:
        missing = rms * float(np.sqrt(1.0 - ratio**-2))
        shares.append(Share("model", "model: errors that hold-out pairs show", "A", missing))
    return tuple(shares)
