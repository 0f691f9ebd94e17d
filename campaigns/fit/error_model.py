"""Model of measured points: a robot, all its sources of error, and the tracker's frame.

Theory of operation. A shot i is a reading of all joints and a point y_i that the tracker measured:

    y_i = R_f(i) X(p; joints_i) + t_f(i) + Σ_k x_k c_k(y_i) + e_i

X is the kinematic model with parameters p, R and t the frame of the shot's session f(i), c_k the
columns of the tracker's errors, e_i noise. Every source of error that has a column is always in the
model as an unknown with a prior of mean 0: there is no choice of a model to make. Unknowns x are
deviations from nominal in units of their tolerances, so that every prior is N(0, ρ²) with a size ρ
that is 1 for parts within their tolerance; this also scales the columns for the linear algebra. The
six unknowns of each frame are flat, without a prior: a turn in mrad and a shift in mm. Effects of
one campaign (`effects.py`) move joints, parameters, points or frames of some shots; their unknowns
follow those of the table in x.

`ErrorModel.predict` is the one function from unknowns to residuals, predicted less measured, and
their derivatives: the fit, hold-out pairs, plans and the gate of a run ask it.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Self

import numpy as np

from campaigns.arrays import Array, Index, Mask
from campaigns.fit.effects import Effect, Moved, Step, Walk
from campaigns.fit.error_sources import (
    SOURCES,
    TRACKER_SOURCES,
    middle_of,
    tolerance_of,
    tracker_columns,
)
from campaigns.fit.kinds import Block
from campaigns.fit.predicted_rows import PredictedRows, SeenPlaces, predict_block, seen_places
from campaigns.fit.rigid_transforms import (
    MRAD,
    Transform,
    fit_transform,
    frame_jacobian,
    rotation_vector_rad,
)
from campaigns.kinematics.mechanism import Assembly
from campaigns.kinematics.model import Kinematics
from campaigns.kinematics.parameters import INNER, Role, Unit
from campaigns.kinematics.rotations import matrices_of

BY_NAME = "tolerance of "
"""First words of the group of a parameter with a tolerance of its own."""
GROSS_MEDIANS = 6.0
"""Distance from the nominal robot's points, in medians of all distances, beyond which a shot has no
weight in the first steps of a fit."""


@dataclass(frozen=True, slots=True, eq=False)
class Observations:
    """Measured points with the joints read at that moment; a row each."""

    joints: Array
    """Encoder readings, (N, n), rad or mm."""
    approach: Array
    """Signs of the joints' last motions, 0 if unknown, (N, n)."""
    near: Array
    """Commanded poses, from which the search begins, (N, t)."""
    points: Array
    """In the tracker's frame, (N, 3)."""
    noise: Mapping[str, Array]
    """Covariance by part, (N, 3, 3) each: "stated" is taken as it is; the factors of "along" and
    "across" the beam, of data-sheet values, are estimated."""
    frame: Index
    """Number of the frame of each shot's session, (N,), counted from 0."""
    warmth: Array
    """Degrees by which parts are warmer than the reference, (N,); 0 where unknown."""
    moment: Array
    """Rank of each shot in the order of time, (N,); infinite for poses of the robot of today."""
    time: Array
    """Time of each shot in its session, from 0 to 1, (N,)."""
    former: Array
    """Encoder readings at the shot before, (N, n); the same joints where there is none."""
    blocks: tuple[Block, ...] = ()
    """Observations of other kinds than points."""

    def __len__(self) -> int:
        return len(self.points)

    @property
    def middle(self) -> Array:
        """Mean of the points, (3,), about which the tracker's error of scale is counted.

        Without points it is that of the places that a tracker saw otherwise.
        """
        by_tracker = [block.values[:, :3] for block in self.blocks if block.kind.by_tracker]
        if len(self.points) or not by_tracker:
            return middle_of(self.points)
        return middle_of(np.concatenate(by_tracker))

    @classmethod
    def unmeasured(cls, joints: Array, near: Array, approach: Array | None = None) -> Self:
        """Return observations of joints (N, n) at poses (N, t) that are not measured yet."""
        return cls(
            joints=joints,
            approach=np.zeros_like(joints) if approach is None else approach,
            near=near,
            points=near[:, :3],
            noise={},
            frame=np.zeros(len(joints), dtype=np.intp),
            warmth=np.zeros(len(joints)),
            moment=np.full(len(joints), np.inf),
            time=np.zeros(len(joints)),
            former=joints,
        )

    # What has no moment is of today: no slow motion of a session's stand concerns it.
    @classmethod
    def of_body(cls, block: Block, number: int) -> Self:
        """Return what effects ask of one of the bodies of a block, at all its observations."""
        joints = block.joints[:, number]
        return replace(
            cls.unmeasured(joints, block.near[:, number]),
            frame=np.where(np.isfinite(block.moment), block.frame, -1),
            warmth=block.warmth,
            moment=block.moment,
            time=block.time,
        )

    def rows(self, rows: Index | Mask) -> Self:
        """Return the observations of these rows, with all those of other kinds."""
        columns = {
            name: getattr(self, name)[rows]
            for name in self.__slots__  # all columns but the noise, which is a mapping of columns
            if name not in ("noise", "blocks")
        }
        noise = {part: covariance[rows] for part, covariance in self.noise.items()}
        return replace(self, noise=noise, **columns)


@dataclass(frozen=True, slots=True, eq=False)
class Prediction:
    """Points predicted at given unknowns: residuals and derivatives, in the tracker's frame."""

    x: Array
    """Unknowns in tolerances, then those of effects in usual sizes, (P,)."""
    frames: tuple[Transform, ...]
    """`tracker_from_base` of each session, F of them."""
    assembly: Assembly
    residual: Array
    """Predicted minus measured, (N, 3), mm."""
    jacobian: Array
    """∂residual/∂(unknowns, frames), (N, 3, P + 6 F)."""
    by_moves: Mapping[Moved, Array]
    """∂point by what effects move, (N, 3, m): joints in rad or mm, the model's own unknowns in
    tolerances, the point in the base frame, the shot's own frame in mrad and mm."""
    others: tuple[PredictedRows, ...] = ()
    """Rows of the other kinds of observation, block by block."""

    @property
    def by_joint(self) -> Array:
        """∂point/∂joints, (N, 3, n), mm per rad or mm."""
        return self.by_moves["joints"]

    def columns_of(self, effect: Effect, observations: Observations) -> Array:
        """Return ∂residual/∂z (N, 3, k) of an effect."""
        return np.asarray(self.by_moves[effect.moves] @ effect.basis(observations))


@dataclass(frozen=True, slots=True, eq=False)
class RobotPoints:
    """Points of a robot at given unknowns, in its base frame, with their derivatives."""

    assembly: Assembly
    by: Array
    """∂point/∂unknowns, (N, 3, P), effects included."""
    by_moves: Mapping[Moved, Array]
    """∂point by what effects move, (N, 3, m)."""
    frame_moves: Array
    """Motions of the tracker's frame by effects, (N, 6): mrad and mm."""


@dataclass(frozen=True, eq=False)
class ErrorModel:
    """All unknowns of a robot and its tracker, with their tolerances."""

    nominal: Kinematics
    held: Collection[str] = ()
    """Names of parameters that stay at nominal."""
    tolerances: Mapping[str, float] = field(default_factory=dict)
    """1 σ by name instead of the table's, in mm, rad or ratios; each has a size of its own."""
    group_tolerances: Mapping[str, float] = field(default_factory=dict)
    """Tolerances instead of the table's, by a tracker's source or by group and unit: `rods_deg`."""
    with_growth: bool = False
    """Whether shots have temperatures of parts, from which the expansion of parts is estimated."""
    effects: tuple[Effect, ...] = ()
    """Effects of this campaign; their unknowns follow those that have names."""

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Names of the unknowns, (P,): parameters of the robot, then sources of the tracker."""
        mechanism = self.nominal.mechanism
        table = mechanism.parameters
        # a ripple of unknown period, or growth without temperatures, has no column
        names = [
            parameter.name
            for parameter in table.rows
            if (parameter.field.role is not Role.GROWTH or self.with_growth)
            and (parameter.field.group != "ripple" or mechanism.has_ripple(parameter.arm))
        ]
        return tuple(name for name in (*names, *TRACKER_SOURCES) if name not in self.held)

    @cached_property
    def parameters(self) -> tuple[str, ...]:
        """Names of the unknowns that are parameters of the robot."""
        return tuple(name for name in self.names if name not in TRACKER_SOURCES)

    @cached_property
    def places(self) -> Index:
        """Places of these parameters in a vector of the mechanism's parameters."""
        return self.nominal.mechanism.parameters.places(self.parameters)

    @cached_property
    def groups(self) -> tuple[str, ...]:
        """Group of each unknown, (P,)."""
        table = self.nominal.mechanism.parameters
        return tuple(n if n in TRACKER_SOURCES else table[n].field.group for n in self.names)

    @cached_property
    def units(self) -> tuple[Unit, ...]:
        """Unit of each unknown in files and on screens, (P,)."""
        table = self.nominal.mechanism.parameters
        return tuple(TRACKER_SOURCES.get(n) or table[n].unit for n in self.names)

    @cached_property
    def file_tolerance(self) -> Array:
        """Tolerance of each unknown in its unit in files, (P,): mm, deg or ppm."""
        return np.asarray(self.tolerance / [INNER[unit] for unit in self.units])

    @cached_property
    def tolerance(self) -> Array:
        """Tolerance of each unknown, (P,), mm, rad or ratio."""
        return np.array(
            [self._tolerance(*row) for row in zip(self.names, self.groups, strict=True)]
        )

    def _tolerance(self, name: str, group: str) -> float:
        if name in self.tolerances:
            return self.tolerances[name]
        if name in TRACKER_SOURCES:
            return self.group_tolerances.get(name, SOURCES[name].of_angles)
        parameter = self.nominal.mechanism.parameters[name]
        return self.group_tolerances.get(f"{group}_{parameter.unit}", tolerance_of(parameter))

    @cached_property
    def learned(self) -> dict[str, Index]:
        """Places of the unknowns of each group whose size is estimated."""
        # A tolerance by name is somebody's word for one parameter: its size is its own, so that
        # shots may contradict it.
        rows: dict[str, list[int]] = {}
        for place, (name, group) in enumerate(zip(self.names, self.groups, strict=True)):
            if name in self.tolerances:
                rows[BY_NAME + name] = [place]
            elif SOURCES[group].is_learned:
                rows.setdefault(group, []).append(place)
        return {group: np.array(places) for group, places in rows.items()}

    @cached_property
    def size(self) -> int:
        """Number of unknowns, those of effects included, frames not."""
        return len(self.names) + sum(effect.count for effect in self.effects)

    @cached_property
    def effect_places(self) -> tuple[slice, ...]:
        """Places of each effect's unknowns."""
        ends = len(self.names) + np.cumsum([0, *(effect.count for effect in self.effects)])
        return tuple(
            slice(*pair) for pair in zip(ends[:-1].tolist(), ends[1:].tolist(), strict=True)
        )

    @cached_property
    def sized_groups(self) -> dict[str, Index]:
        """Places of the unknowns of each group of sources and effects whose size is estimated."""
        places = {group: list(indices) for group, indices in self.learned.items()}
        for effect, where in zip(self.effects, self.effect_places, strict=True):
            place = where.start
            for group, count in effect.sizes_of:
                if group:
                    places.setdefault(group, []).extend(range(place, place + count))
                place += count
        return {group: np.array(indices) for group, indices in places.items()}

    def with_robot(self, nominal: Kinematics, effects: tuple[Effect, ...]) -> "ErrorModel":
        """Return the model of a robot with other unknowns, and with these effects of this model."""
        other = replace(self, nominal=nominal, effects=())
        moved = tuple(
            effect.with_names(self.names, other.names) if isinstance(effect, Step) else effect
            for effect in effects
        )
        return other.with_effects(moved)

    def with_effects(self, effects: tuple[Effect, ...]) -> "ErrorModel":
        """Return the model with these effects instead of its own."""
        return replace(self, effects=effects)

    def kinematics(self, x: Array) -> Kinematics:
        """Return the robot with the deviations `x` (P or more,) in tolerances."""
        p, count = self.nominal.whole_p, len(self.parameters)
        in_robot = self.places < len(p)  # growth is no parameter of a robot
        change = x[:count] * self.tolerance[:count]
        p[self.places[in_robot]] += change[in_robot]
        return Kinematics(self.nominal.mechanism, p)

    @cached_property
    def of_today(self) -> Array:
        """Matrix (P, P + effects) from all unknowns to those of the robot of today.

        Changes of parameters that last are added to the robot's own.
        """
        matrix = np.eye(len(self.names), self.size)
        for effect, where in zip(self.effects, self.effect_places, strict=True):
            if isinstance(effect, Step) and effect.is_lasting and effect.moves == "unknowns":
                matrix[:, where] = effect.by_unknowns
        return matrix

    def frame_of_today(self, frames: int) -> Array:
        """Return the matrix (6, P + effects + 6 F) from all unknowns to today's frame, mrad and mm.

        That is the last one of F, at the end of its session, with the changes that last.
        """
        matrix = np.zeros((6, self.size + 6 * frames))
        matrix[:, -6:] = np.eye(6)
        for effect, where in zip(self.effects, self.effect_places, strict=True):
            if isinstance(effect, Walk) and effect.session == frames - 1:
                matrix[:, where] = effect.at_end
            elif isinstance(effect, Step) and effect.is_lasting and effect.moves == "frame":
                matrix[:, where] = effect.by_unknowns
        return matrix

    def positions(
        self, x: Array, observations: Observations, near: Array
    ) -> tuple[Kinematics, Assembly]:
        """Return the robot at `x`, and its assembly at the observed joints."""
        robot = self.kinematics(x)
        assembly = robot.mechanism.assemble(
            robot.p, observations.joints, near, observations.approach
        )
        return robot, assembly

    def robot_columns(
        self, robot: Kinematics, observations: Observations, unknowns: Array
    ) -> tuple[Array, Array]:
        """Return ∂position/∂x (N, 3, P) and ∂position/∂joints (N, 3, n) in the base frame.

        Columns of the tracker's sources are 0. `unknowns` (N, k) are the plate's, of the assembly
        at the joints.
        """
        mechanism, table = robot.mechanism, robot.mechanism.parameters
        by_p = mechanism.jacobian(robot.p, observations.joints, unknowns, observations.approach)
        by_p = mechanism.point_rows(unknowns, by_p)
        by_joint = by_p[..., table.columns["joint_offset"]]  # an offset moves as its joint does
        if self.with_growth:
            grown = mechanism.growth_columns(robot.p, by_p, observations.joints)
            by_p = np.concatenate([by_p, grown * observations.warmth[:, None, None]], axis=2)
        columns = np.zeros((len(observations), 3, len(self.names)))
        count = len(self.parameters)
        columns[..., :count] = by_p[..., self.places] * self.tolerance[:count]
        return columns, by_joint

    def columns_of(self, by_p: Array) -> Array:
        """Return derivatives (N, 3, P) by the unknowns, from those by the robot's parameters.

        Columns of growth, unless the last of these are by it, and of the tracker's sources are 0.
        """
        of_robot, count = self.places < by_p.shape[2], len(self.parameters)
        columns = np.zeros((*by_p.shape[:2], len(self.names)))
        tolerance = self.tolerance[:count][of_robot]
        columns[..., np.flatnonzero(of_robot)] = by_p[..., self.places[of_robot]] * tolerance
        return columns

    # Moved joints and parameters enter the kinematics, moved points are added. Growth is small: its
    # columns times its unknowns are added to the points as well.
    def robot_at(self, x: Array, observations: Observations, near: Array) -> "RobotPoints":
        """Return the robot's points in its base frame with their derivatives by all unknowns.

        `near` (N, t or more) are the plate's unknowns at which the assembly begins. Columns of the
        tracker's errors and of motions of the frame are 0.
        """
        bases = [effect.basis(observations) for effect in self.effects]
        moves = self._moves(x, bases, observations)
        moved = replace(observations, joints=observations.joints + moves["joints"])
        assembled = self._assembled(x, moves["unknowns"], moved, near)
        columns, by_joint = assembled.by_unknowns, assembled.by_joint
        shifts = moves["point"]
        if self.with_growth:
            growth = [place for place, group in enumerate(self.groups) if group == "growth"]
            shifts = shifts + columns[..., growth] @ x[growth]
        by_moves: dict[Moved, Array] = {
            "joints": by_joint,
            "unknowns": columns,
            "point": np.broadcast_to(np.eye(3), (len(observations), 3, 3)),
            "frame": np.zeros((len(observations), 3, 6)),
        }
        by_effects = [
            by_moves[effect.moves] @ basis
            for effect, basis in zip(self.effects, bases, strict=True)
        ]
        return RobotPoints(
            assembly=shift_points(assembled.assembly, shifts),
            by=np.concatenate([columns, *by_effects], axis=2),
            by_moves=by_moves,
            frame_moves=moves["frame"],
        )

    # Poses of no moment are of the robot of today, the same one at all of them. Its tool turns by
    # what moves joints and parameters; shifts of points, growth and the tracker leave turns alone.
    def turns_by_unknowns(self, x: Array, observations: Observations, near: Array) -> Array:
        """Return the turn of today's tool by all unknowns, (N, 3, P), rad about the base's axes.

        `observations` are unmeasured, `near` (N, t) are the poses at which the assembly begins.
        """
        bases = [effect.basis(observations) for effect in self.effects]
        moves = self._moves(x, bases, observations)
        moved = replace(observations, joints=observations.joints + moves["joints"])
        today = x[: len(self.names)] + moves["unknowns"][0]
        robot, assembly = self.positions(today, moved, near)
        mechanism = robot.mechanism
        by_p = mechanism.turn_jacobian(
            robot.p, moved.joints, assembly.unknowns, observations.approach
        )
        columns = self.columns_of(by_p)
        by_moves = {
            "joints": by_p[..., mechanism.parameters.columns["joint_offset"]],
            "unknowns": columns,
        }
        by_effects = [
            by_moves[effect.moves] @ basis if effect.moves in by_moves else 0.0 * basis[:, :3]
            for effect, basis in zip(self.effects, bases, strict=True)
        ]
        return np.concatenate([columns, *by_effects], axis=2)

    # Moved frames turn the points. The tracker's errors are small: their columns times their
    # unknowns are added to the predicted points.
    def predict(
        self, x: Array, frames: tuple[Transform, ...], observations: Observations, near: Array
    ) -> Prediction:
        """Predict all points in the tracker's frame and differentiate them by all unknowns.

        `near` (N, t or more) are the plate's unknowns at which the assembly begins.
        """
        robot = self.robot_at(x, observations, near)
        turns, shifts = frames_of_shots(frames, observations.frame)
        if robot.frame_moves.any():
            turns = matrices_of(MRAD * robot.frame_moves[:, :3]) @ turns
            shifts = shifts + robot.frame_moves[:, 3:]
        turned = (turns @ robot.assembly.points[..., None])[..., 0]
        by, predicted = turns @ robot.by, turned + shifts
        for source, column in tracker_columns(observations.points).items():
            if source in self.names:
                place = self.names.index(source)
                by[..., place] = column * self.tolerance[place]
                predicted = predicted + x[place] * by[..., place]
        by_moves = {moved: turns @ columns for moved, columns in robot.by_moves.items()}
        by_moves["frame"] = frame_columns(turned)
        for effect, where in zip(self.effects, self.effect_places, strict=True):
            if effect.moves == "frame":
                by[..., where] = by_moves["frame"] @ effect.basis(observations)
        by_frames = np.zeros((len(observations), 3, 6 * len(frames)))
        for number in range(len(frames)):
            rows = observations.frame == number
            by_frames[rows, :, 6 * number : 6 * number + 6] = by_moves["frame"][rows]
        return Prediction(
            x=x,
            frames=frames,
            assembly=robot.assembly,
            residual=predicted - observations.points,
            jacobian=np.concatenate([by, by_frames], axis=2),
            by_moves=by_moves,
            others=tuple(
                predict_block(self, x, frames, block, observations.middle)
                for block in observations.blocks
            ),
        )

    def moves_of_body(
        self, x: Array, block: Block, number: int
    ) -> tuple[Observations, Mapping[str, Array]]:
        """Return a body of a block as effects see it, and what all effects together move of it."""
        seen = Observations.of_body(block, number)
        return seen, self._moves(x, [effect.basis(seen) for effect in self.effects], seen)

    def _moves(self, x: Array, bases: list[Array], observations: Observations) -> dict[str, Array]:
        """Return the motions that all effects together give to each shot, by what they move."""
        count, joints = observations.joints.shape
        moves = {
            "joints": np.zeros((count, joints)),
            "unknowns": np.zeros((count, len(self.names))),
            "point": np.zeros((count, 3)),
            "frame": np.zeros((count, 6)),
        }
        for effect, where, basis in zip(self.effects, self.effect_places, bases, strict=True):
            moves[effect.moves] += basis @ x[where]
        return moves

    def _assembled(
        self, x: Array, moved: Array, observations: Observations, near: Array
    ) -> "_Assembled":
        """Assemble and differentiate all shots, each with the unknowns that it had.

        `moved` (N, P) are changes of unknowns: shots with equal changes are of one robot.
        """
        if not moved.any():
            robot, assembly = self.positions(x, observations, near)
            columns = self.robot_columns(robot, observations, assembly.unknowns)
            return _Assembled(assembly, *columns)
        changes, of_robot = np.unique(moved, axis=0, return_inverse=True)
        order, parts = [], []
        for number, change in enumerate(changes):
            rows = np.flatnonzero(of_robot.ravel() == number)
            shots = observations.rows(rows)
            robot, assembly = self.positions(x[: len(self.names)] + change, shots, near[rows])
            columns = self.robot_columns(robot, shots, assembly.unknowns)
            order.append(rows)
            parts.append(_Assembled(assembly, *columns))
        return _Assembled.of_parts(parts, np.argsort(np.concatenate(order)))


@dataclass(frozen=True, slots=True, eq=False)
class _Assembled:
    """Assembly of shots with its derivatives by the model's unknowns and by the joints."""

    assembly: Assembly
    by_unknowns: Array
    """(N, 3, P)"""
    by_joint: Array
    """(N, 3, n)"""

    @classmethod
    def of_parts(cls, parts: Sequence[Self], order: Index) -> Self:
        """Join assemblies of some shots each, and put all shots into an order (N,)."""
        # robots without tilts have fewer unknowns: those of a level plate are 0
        assemblies = [part.assembly for part in parts]
        width = max(assembly.unknowns.shape[1] for assembly in assemblies)
        unknowns = [
            np.pad(assembly.unknowns, ((0, 0), (0, width - assembly.unknowns.shape[1])))
            for assembly in assemblies
        ]
        return cls(
            Assembly(
                np.concatenate(unknowns)[order],
                np.concatenate([assembly.poses for assembly in assemblies])[order],
                np.concatenate([assembly.points for assembly in assemblies])[order],
                np.concatenate([assembly.is_solved for assembly in assemblies])[order],
            ),
            np.concatenate([part.by_unknowns for part in parts])[order],
            np.concatenate([part.by_joint for part in parts])[order],
        )


def shift_points(assembly: Assembly, shifts: Array) -> Assembly:
    """Return an assembly whose points are shifted (N, 3), such as by parts that have grown."""
    return replace(assembly, points=assembly.points + shifts)


def frame_columns(turned: Array) -> Array:
    """Return the derivatives (N, 3, 6) of points by their frame: per mrad of turn, per mm of shift.

    `turned` (N, 3) are the points after the frame's rotation, before its shift, mm.
    """
    return np.asarray(frame_jacobian(turned) * np.array([MRAD, MRAD, MRAD, 1.0, 1.0, 1.0]))


def frames_of_shots(frames: tuple[Transform, ...], frame: Index) -> tuple[Array, Array]:
    """Return the rotation (N, 3, 3) and shift (N, 3) of each shot's session, by its number."""
    if not frames:  # without points there is none
        return np.zeros((0, 3, 3)), np.zeros((0, 3))
    turns = np.stack([transform.rotation for transform in frames])
    shifts = np.stack([transform.translation_mm for transform in frames])
    return turns[frame], shifts[frame]


# R ← exp(ψ×) R, as `frame_columns` has its derivatives: there are no singular angles.
def moved_frames(frames: tuple[Transform, ...], step: Array) -> tuple[Transform, ...]:
    """Return frames after a step (6 F,) of turns in mrad and shifts in mm."""
    steps = step.reshape(len(frames), 6)
    return tuple(
        Transform(
            matrices_of(MRAD * of_frame[:3]) @ frame.rotation, frame.translation_mm + of_frame[3:]
        )
        for frame, of_frame in zip(frames, steps, strict=True)
    )


def frame_motion(before: Transform, now: Transform) -> Array:
    """Return the step (6,) from one frame to another: turns in mrad, shifts in mm."""
    turn_rad = rotation_vector_rad(now.rotation @ before.rotation.T)
    return np.concatenate([turn_rad / MRAD, now.translation_mm - before.translation_mm])


# Points farther off than six medians and 1 mm are left out three times, for a far point pulls the
# first fit and hides others. The median does not follow them while they are fewer than half.
def first_frames(
    observations: Observations, positions: Array, is_solved: Mask, others: Sequence[SeenPlaces] = ()
) -> tuple[tuple[Transform, ...], Mask]:
    """Return the frames that fit the nominal robot best, and which points are near its own.

    `positions` (N, 3) are the nominal robot's where it `is_solved`; `others` are places that a
    tracker saw beside points, which come after these in the mask. Without any there are no frames.
    Raise `ValueError` for a session of fewer than three of them, or of places on a line.
    """
    kept = np.concatenate([is_solved, *(np.ones(len(seen), dtype=bool) for seen in others)])
    if not len(kept):
        return (), kept
    positions = np.concatenate([positions, *(seen.in_base for seen in others)])
    points = np.concatenate([observations.points, *(seen.by_tracker for seen in others)])
    frame = np.concatenate([observations.frame, *(seen.frame for seen in others)])
    for _ in range(3):
        frames = tuple(
            fit_transform(positions[rows], points[rows])
            for number in range(int(frame.max()) + 1)
            for rows in [kept & (frame == number)]
        )
        turns, shifts = frames_of_shots(frames, frame)
        predicted = (turns @ positions[..., None])[..., 0] + shifts
        distance = np.linalg.norm(predicted - points, axis=1)
        limit = GROSS_MEDIANS * np.median(distance[kept]) + 1.0
        is_near = ~(distance > limit)
        is_near[: len(is_solved)] &= is_solved
        kept = is_near
    return frames, kept


def places_by_tracker(model: ErrorModel, blocks: Sequence[Block]) -> dict[int, SeenPlaces]:
    """Return the places that a tracker saw at observations of other kinds, by the block's row."""
    return {
        row: seen_places(model, block) for row, block in enumerate(blocks) if block.kind.has_places
    }
