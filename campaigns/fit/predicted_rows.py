"""Rows of observations of other kinds than points, and their derivatives by all unknowns.

A kind of observation (`kinds.py`) has derivatives of its rows by places and turns of bodies; the
mechanism has those of bodies by parameters and joints. Chained, they are the columns of the fit.
The robot's own scatter comes to the rows by the same derivatives.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.fit.effects import Effect, Moved
from campaigns.fit.error_sources import (
    SCATTER_TOLERANCE_MM,
    by_first_joint,
    scatter_tolerances,
    tracker_columns,
)
from campaigns.fit.kinds import Block, Bodies, Differentiated, differentiate
from campaigns.fit.rigid_transforms import MRAD, Transform
from campaigns.fit.slots import Slot
from campaigns.kinematics.axes import Axis
from campaigns.kinematics.model import Kinematics
from campaigns.kinematics.rotations import matrices_of

if TYPE_CHECKING:
    from campaigns.fit.error_model import ErrorModel, Observations


@dataclass(frozen=True, slots=True, eq=False)
class BodyMoves:
    """Derivatives of rows by what effects move of one body."""

    seen: "Observations"
    """The body at all observations, as effects see it."""
    by_moves: Mapping[Moved, Array]
    """∂row by what effects move, (M, r, m): units as those of a `Prediction`."""


@dataclass(frozen=True, slots=True, eq=False)
class PredictedRows:
    """Rows of observations of one kind and object, predicted at given unknowns."""

    residual: Array
    """Predicted less measured, (M, r), mm."""
    jacobian: Array
    """∂residual/∂(unknowns, frames), (M, r, P + 6 F)."""
    noise: dict[str, Array]
    """Parts of the covariance, (M, r, r), mm²: as stated, and the robot's at its tolerances."""
    bodies: tuple[BodyMoves, ...]

    def columns_of(self, effect: Effect) -> Array:
        """Return ∂residual/∂z (M, r, k) of an effect."""
        columns = (body.by_moves[effect.moves] @ effect.basis(body.seen) for body in self.bodies)
        return np.asarray(sum(columns))


@dataclass(frozen=True, slots=True, eq=False)
class MovedBody:
    """One body at all observations of a block, with the derivatives of its places and turns."""

    seen: "Observations"
    bodies: Bodies
    """In the base frame."""
    place_by: Mapping[Moved, Array]
    """∂place by what effects move, (M, 3, m)."""
    turn_by: Mapping[Moved, Array]
    frame_moves: Array
    """Motions of the tracker's frame by effects, (M, 6): mrad and mm."""

    def place_by_unknowns(self, model: "ErrorModel") -> Array:
        """Return ∂place/∂x (M, 3, P) in the base frame, effects included."""
        columns = [self.place_by["unknowns"]]
        for effect in model.effects:
            basis = effect.basis(self.seen)
            of_effect = self.place_by.get(effect.moves, np.zeros((len(basis), 3, basis.shape[1])))
            columns.append(of_effect @ basis)
        return np.concatenate(columns, axis=2)


# 1. Bodies in the base frame, each at its moment with the effects of then, and from there in the
#    tracker's.
# 2. Rows there, with their derivatives by places, turns and slots.
# 3. Derivatives by unknowns, effects and joints, chained.
def predict_block(
    model: "ErrorModel", x: Array, frames: tuple[Transform, ...], block: Block, middle: Array
) -> PredictedRows:
    """Predict the rows of a block at unknowns x (P,) and differentiate them by all unknowns.

    `middle` (3,) is that of the tracker's points. Raise `ValueError` for a block that a tracker
    measured from where no frame is.
    """
    moved = [moved_body(model, x, block, number) for number in range(len(block.parts))]
    turn, shift = _frames_of(block, frames, moved[0].frame_moves)
    seen = [
        Bodies((turn @ body.bodies.place[..., None])[..., 0] + shift, turn @ body.bodies.axes)
        for body in moved
    ]
    slots, places = slots_of(model, block)
    values = [slot.values(x[where]) for slot, where in zip(slots, places, strict=True)]
    at = differentiate(block.kind, block.values, seen, np.concatenate(values))
    bodies = tuple(
        BodyMoves(body.seen, _chained(block, at, number, body, turn, in_frame.place - shift))
        for number, (body, in_frame) in enumerate(zip(moved, seen, strict=True))
    )
    residual, size = at.residual.copy(), model.size
    jacobian = np.zeros((*residual.shape, size + 6 * len(frames)))
    jacobian[..., : len(model.names)] = sum(body.by_moves["unknowns"] for body in bodies)
    predicted = PredictedRows(
        residual, jacobian, _noise_of(block, model.nominal.mechanism.joints, bodies), bodies
    )
    for effect, where in zip(model.effects, model.effect_places, strict=True):
        if not isinstance(effect, Slot):
            jacobian[..., where] = predicted.columns_of(effect)
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
        by_frame = np.asarray(sum(body.by_moves["frame"] for body in bodies))
        for number in range(len(frames)):
            of_frame, first = block.frame == number, size + 6 * number
            jacobian[of_frame, :, first : first + 6] = by_frame[of_frame]
    return predicted


def _chained(
    block: Block, at: Differentiated, number: int, body: MovedBody, turn: Array, turned: Array
) -> dict[Moved, Array]:
    """Return the derivatives of rows (M, r, m) by what effects move of one body.

    `turn` (M, 3, 3) turns from the base into the frame of each value, `turned` (M, 3) are the
    body's places after that, before the frame's shift.
    """
    by_place, by_turn = at.by_place[number], at.by_turn[number]
    chained: dict[Moved, Array] = {
        moved: (by_place @ turn) @ of_place + (by_turn @ turn) @ body.turn_by[moved]
        for moved, of_place in body.place_by.items()
    }
    # per mrad of the frame's turn and per mm of its shift: ∂r/∂X · (e × X) = e · (X × ∂r/∂X)
    by_motion = by_turn + np.cross(turned[:, None], by_place)
    by_frame = np.concatenate([MRAD * by_motion, by_place], axis=2)
    return chained | {"frame": by_frame if block.kind.by_tracker else 0.0 * by_frame}


def _frames_of(block: Block, frames: tuple[Transform, ...], moves: Array) -> tuple[Array, Array]:
    """Return rotations (M, 3, 3) and shifts (M, 3) from the base into the frame of each value.

    `moves` (M, 6) are the motions of the tracker's frame by effects, mrad and mm.
    """
    if not block.kind.by_tracker:
        return np.broadcast_to(np.eye(3), (len(block), 3, 3)), np.zeros((len(block), 3))
    if block.frame.max(initial=0) >= len(frames):
        raise ValueError(f"no points place the tracker's frame of {block.name}")
    turns = np.stack([frame.rotation for frame in frames])[block.frame]
    shifts = np.stack([frame.translation_mm for frame in frames])[block.frame]
    return matrices_of(MRAD * moves[:, :3]) @ turns, shifts + moves[:, 3:]


# Bodies at one shot share the robot's scatter: their derivatives add before they are squared.
def _noise_of(block: Block, axes: Sequence[Axis], bodies: Sequence[BodyMoves]) -> dict[str, Array]:
    """Return the parts of the noise (M, r, r) of rows with these derivatives of each body.

    `axes` are the robot's joints.
    """
    by_points = [body.by_moves["point"] for body in bodies]
    by_scatter = [by_first_joint(axes, body.by_moves["joints"]) for body in bodies]
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


def slots_of(model: "ErrorModel", block: Block) -> tuple[list[Slot], list[slice]]:
    """Return the slots of a block in its order, and the places of their unknowns."""
    named = {
        effect.name: (effect, where)
        for effect, where in zip(model.effects, model.effect_places, strict=True)
        if isinstance(effect, Slot)
    }
    slots, places = zip(*(named[name] for name in block.slots), strict=True)
    return list(slots), list(places)


@dataclass(frozen=True, slots=True, eq=False)
class SeenPlaces:
    """Places that a tracker saw, with those of the nominal robot in its base frame."""

    in_base: Array
    """(M, 3), mm."""
    by_tracker: Array
    """(M, 3), mm."""
    frame: Index
    """Number of the frame of each, (M,)."""

    def __len__(self) -> int:
        return len(self.frame)


# The first rows of kinds of a tracker are predicted less measured places of their first body. With
# the base as the frame, these and the measured places are the nominal robot's own.
def seen_places(model: "ErrorModel", block: Block) -> SeenPlaces:
    """Return the places of a block that a tracker measured, by the nominal robot and its slots."""
    x = np.zeros(model.size)
    bodies = [moved_body(model, x, block, number).bodies for number in range(len(block.parts))]
    slots = np.concatenate([slot.start for slot in slots_of(model, block)[0]])
    seen = block.values[:, :3]
    rows = np.asarray(block.kind.rows(block.values, bodies, slots[None]))
    return SeenPlaces(rows[:, :3] + seen, seen, block.frame)


# Moved joints and parameters enter the kinematics, moved points and growth are added. A part that
# changed between observations makes them of several robots.
def moved_body(model: "ErrorModel", x: Array, block: Block, number: int) -> MovedBody:
    """Return one of a block's bodies at all its observations, each with the effects of then."""
    seen, moves = model.moves_of_body(x, block, number)
    changes, of_robot = np.unique(moves["unknowns"], axis=0, return_inverse=True)
    body = (block.parts[number], block.kind.by_tracker)
    order, parts = [], []
    for robot, change in enumerate(changes):
        rows = np.flatnonzero(of_robot.ravel() == robot)
        kinematics = model.kinematics(x[: len(model.names)] + change)
        joints = seen.joints[rows] + moves["joints"][rows]
        at = (joints, seen.near[rows], seen.warmth[rows])
        parts.append(_assembled(model, kinematics, body, at))
        order.append(rows)
    back = np.argsort(np.concatenate(order))
    place, axes, place_by_unknowns, turn_by_unknowns, place_by_joint, turn_by_joint = (
        np.concatenate(columns)[back] for columns in zip(*parts, strict=True)
    )
    growth = [at for at, group in enumerate(model.groups) if group == "growth"]
    place = place + place_by_unknowns[..., growth] @ x[growth] + moves["point"]
    ones = np.broadcast_to(np.eye(3), (len(block), 3, 3))
    return MovedBody(
        seen,
        Bodies(place, axes),
        {"joints": place_by_joint, "unknowns": place_by_unknowns, "point": ones},
        {"joints": turn_by_joint, "unknowns": turn_by_unknowns, "point": 0.0 * ones},
        moves["frame"],
    )


# On a half of a plate the tool's turn about z is not seen: a half only translates and tilts. Parts
# that grow shift a body and do not turn it.
def _assembled(
    model: "ErrorModel",
    robot: Kinematics,
    body: tuple[int | None, bool],
    at: tuple[Array, Array, Array],
) -> tuple[Array, ...]:
    """Return places (M, 3) and axes (M, 3, 3) of a body, and both by unknowns and by joints.

    `body` is the part that it is on, and whether a tracker saw it; `at` are joints (M, n), poses
    (M, t) from which the search begins, and warmth (M,), °C.
    """
    (part, by_tracker), (joints, near, warmth) = body, at
    mechanism, size = robot.mechanism.body(part), len(robot.mechanism.task)
    signs = np.zeros(joints.shape)
    assembly = mechanism.assemble(robot.p, joints, near, signs)
    unknowns = assembly.unknowns
    by_p = mechanism.jacobian(robot.p, joints, unknowns, signs)
    turn_by_p = mechanism.turn_jacobian(robot.p, joints, unknowns, signs)
    level = unknowns.copy()
    if part is not None:
        turn_by_p[:, 2] -= by_p[:, 3:size].sum(axis=1)
        level[:, 3:size] = 0.0
    places, place_by_p = assembly.poses[:, :3], by_p[:, :3]
    if by_tracker:
        taken_up, by_reflector = robot.mechanism.reflector_in_frames(robot.p)
        places, place_by_p = places - taken_up, place_by_p - by_reflector
    if model.with_growth:
        grown = mechanism.growth_columns(robot.p, place_by_p, joints) * warmth[:, None, None]
        place_by_p = np.concatenate([place_by_p, grown], axis=2)
    offsets = mechanism.parameters.columns["joint_offset"]
    return (
        places,
        mechanism.tool_axes(level),
        model.columns_of(place_by_p),
        model.columns_of(turn_by_p),
        by_p[:, :3, offsets],
        turn_by_p[..., offsets],
    )
