"""Rows of observations of other kinds than points, and their derivatives by all unknowns.

A kind of observation (`kinds.py`) has derivatives of its rows by places and turns of bodies; the
mechanism has those of bodies by parameters and joints. Chained, they are the columns of the fit.
The robot's own scatter comes to the rows by the same derivatives.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from campaigns.arrays import Array
from campaigns.fit.error_sources import (
    SCATTER_TOLERANCE_MM,
    by_first_joint,
    scatter_tolerances,
    tracker_columns,
)
from campaigns.fit.kinds import Block, Bodies, Differentiated, differentiate
from campaigns.fit.rigid_transforms import MRAD, Transform
from campaigns.fit.slots import Slot
from campaigns.kinematics.model import Kinematics

if TYPE_CHECKING:
    from campaigns.fit.error_model import ErrorModel


@dataclass(frozen=True, slots=True, eq=False)
class PredictedRows:
    """Rows of observations of one kind and object, predicted at given unknowns."""

    residual: Array
    """Predicted less measured, (M, r), mm."""
    jacobian: Array
    """∂residual/∂(unknowns, frames), (M, r, P + 6 F)."""
    noise: dict[str, Array]
    """Parts of the covariance, (M, r, r), mm²: as stated, and the robot's at its tolerances."""


@dataclass(frozen=True, slots=True, eq=False)
class MovedBodies:
    """Bodies in the base frame, with the derivatives of their places and turns."""

    bodies: Bodies
    place_by_unknowns: Array
    """(M, 3, P), effects included."""
    turn_by_unknowns: Array
    place_by_joint: Array
    """(M, 3, n)"""
    turn_by_joint: Array


# Blocks have no moment: they are of the robot of today, with the changes that last.
#
# 1. Bodies in the base frame, and from there in the tracker's.
# 2. Rows there, with their derivatives by places, turns and slots.
# 3. Derivatives by unknowns and joints, chained.
def predict_block(
    model: "ErrorModel", x: Array, frames: tuple[Transform, ...], block: Block, middle: Array
) -> PredictedRows:
    """Predict the rows of a block at unknowns x (P,) and differentiate them by all unknowns.

    `middle` (3,) is that of the tracker's points. Raise `ValueError` for a block that a tracker
    measured from where no frame is.
    """
    robot = model.kinematics(model.of_today @ x)
    moved = [moved_bodies(model, robot, block, place) for place in range(len(block.parts))]
    turn, shift = _frames_of(block, frames)
    seen = [
        Bodies((turn @ body.bodies.place[..., None])[..., 0] + shift, turn @ body.bodies.axes)
        for body in moved
    ]
    slots, places = _slots_of(model, block)
    values = [slot.values(x[where]) for slot, where in zip(slots, places, strict=True)]
    at = differentiate(block.kind, block.values, seen, np.concatenate(values))
    residual, size = at.residual.copy(), model.size
    jacobian = np.zeros((*residual.shape, size + 6 * len(frames)))
    by_points, by_joints = [], []
    for body, seen_place, seen_turn in zip(moved, at.by_place, at.by_turn, strict=True):
        by_place, by_turn = seen_place @ turn, seen_turn @ turn
        jacobian[..., :size] += by_place @ body.place_by_unknowns + by_turn @ body.turn_by_unknowns
        by_points.append(by_place)
        by_joints.append(by_place @ body.place_by_joint + by_turn @ body.turn_by_joint)
    columns, begin = at.by_slots * np.concatenate([slot.std for slot in slots]), 0
    for slot, where in zip(slots, places, strict=True):
        jacobian[..., where] = columns[..., begin : begin + slot.count]
        begin += slot.count
    if block.kind.by_tracker:
        # the tracker's errors come to predicted points, and so to rows as less of the values does
        for point in block.kind.points:
            columns_of = tracker_columns(block.values[:, point], middle)
            for place, source in enumerate(model.names):
                if source in columns_of:
                    column = -(at.by_values[..., point] @ columns_of[source][..., None])[..., 0]
                    jacobian[..., place] += column * model.tolerance[place]
                    residual += x[place] * column * model.tolerance[place]
        by_frame = _by_frame(at, [body.place - shift for body in seen])
        for number in range(len(frames)):
            of_frame, first = block.frame == number, size + 6 * number
            jacobian[of_frame, :, first : first + 6] = by_frame[of_frame]
    noise = _noise_of(block, robot, by_points, by_joints)
    return PredictedRows(residual, jacobian, noise)


def _frames_of(block: Block, frames: tuple[Transform, ...]) -> tuple[Array, Array]:
    """Return rotations (M, 3, 3) and shifts (M, 3) from the base into the frame of each value."""
    if not block.kind.by_tracker:
        return np.broadcast_to(np.eye(3), (len(block), 3, 3)), np.zeros((len(block), 3))
    if block.frame.max(initial=0) >= len(frames):
        raise ValueError(f"no points place the tracker's frame of {block.name}")
    turns = np.stack([frame.rotation for frame in frames])
    shifts = np.stack([frame.translation_mm for frame in frames])
    return turns[block.frame], shifts[block.frame]


def _by_frame(at: Differentiated, turned: list[Array]) -> Array:
    """Return the derivatives (M, r, 6) of rows by their frame: per mrad of turn, per mm of shift.

    `turned` (M, 3) are the places of the bodies after the frame's rotation, before its shift.
    """
    columns = []
    for place, by_place, by_turn in zip(turned, at.by_place, at.by_turn, strict=True):
        # ∂r/∂X · (e × X) = e · (X × ∂r/∂X)
        by_motion = by_turn + np.cross(place[:, None], by_place)
        columns.append(np.concatenate([MRAD * by_motion, by_place], axis=2))
    return np.asarray(sum(columns))


# Bodies at one shot share the robot's scatter: their derivatives add before they are squared.
def _noise_of(
    block: Block, robot: Kinematics, by_points: list[Array], by_joints: list[Array]
) -> dict[str, Array]:
    """Return the parts of the noise (M, r, r) of rows with these derivatives of each body."""
    axes = robot.mechanism.joints
    by_scatter = [by_first_joint(axes, by_joint) for by_joint in by_joints]
    if block.is_of_one_shot:
        by_points, by_scatter = [np.asarray(sum(by_points))], [np.asarray(sum(by_scatter))]
    of_points, of_joints = (
        np.asarray(sum(by @ by.swapaxes(1, 2) for by in parts)) for parts in (by_points, by_scatter)
    )
    return {
        "stated": block.stated,
        "points": SCATTER_TOLERANCE_MM**2 * of_points,
        "joints": scatter_tolerances(axes)[0] ** 2 * of_joints,
    }


def _slots_of(model: "ErrorModel", block: Block) -> tuple[list[Slot], list[slice]]:
    """Return the slots of a block in its order, and the places of their unknowns."""
    named = {
        effect.name: (effect, where)
        for effect, where in zip(model.effects, model.effect_places, strict=True)
        if isinstance(effect, Slot)
    }
    slots, places = zip(*(named[name] for name in block.slots), strict=True)
    return list(slots), list(places)


# On a half of a plate the tool's turn about z is not seen: a half only translates and tilts.
def moved_bodies(model: "ErrorModel", robot: Kinematics, block: Block, number: int) -> MovedBodies:
    """Return one of a block's bodies at all its observations."""
    part = block.parts[number]
    mechanism, size = robot.mechanism.body(part), len(robot.mechanism.task)
    joints, signs = block.joints[:, number], np.zeros(block.joints[:, number].shape)
    assembly = mechanism.assemble(robot.p, joints, block.near[:, number], signs)
    unknowns = assembly.unknowns
    by_p = mechanism.jacobian(robot.p, joints, unknowns, signs)
    turn_by_p = mechanism.turn_jacobian(robot.p, joints, unknowns, signs)
    level = unknowns.copy()
    if part is not None:
        turn_by_p[:, 2] -= by_p[:, 3:size].sum(axis=1)
        level[:, 3:size] = 0.0
    places = assembly.poses[:, :3]
    if block.kind.by_tracker:
        taken_up, by_reflector = robot.mechanism.reflector_in_frames(robot.p)
        places, by_p[:, :3] = places - taken_up, by_p[:, :3] - by_reflector
    offsets = mechanism.parameters.columns["joint_offset"]
    return MovedBodies(
        Bodies(places, mechanism.tool_axes(level)),
        model.columns_of(by_p[:, :3]) @ model.of_today,
        model.columns_of(turn_by_p) @ model.of_today,
        by_p[:, :3, offsets],
        turn_by_p[..., offsets],
    )
