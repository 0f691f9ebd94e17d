"""Mechanisms that their closures alone state.

Theory of operation. A mechanism has n joints q and a pose y of t coordinates. It closes where

    misfit(fields, q, y) = 0            t equations

From these follow

    forward model   Newton's method in y, from a pose nearby
    inverse model   Newton's method in q, from the joints of perfect parts
    derivatives     dy/dp = -F_y⁻¹ F_p, the implicit function theorem
    singularity     the smallest singular value of F_y, with rows of unit length

All derivatives of the closures F are steps into the imaginary direction, exact to rounding.
"""

from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import ClassVar, Self, get_args

import numpy as np
from typing_extensions import override

from campaigns.arrays import Array, Index, Mask
from campaigns.kinematics import transmission
from campaigns.kinematics.axes import FIXED_Z, POSITION, Axis, AxisKind
from campaigns.kinematics.limbs import STEP, Fields
from campaigns.kinematics.mechanism import Assembly, Margins, Mechanism
from campaigns.kinematics.parameters import (
    DRIVE_PERIOD,
    RIPPLES_PER_TURN,
    ParameterField,
    ParameterTable,
)
from campaigns.kinematics.platforms import Place
from campaigns.kinematics.rotations import turn_between

Rows = Index | slice
ALL_ROWS = slice(None)
MOST_ROUNDS = 40
CONVERGED_MM = 1e-8
"""Step of Newton's method below which a pose or joints have been reached, mm or mm at a lever."""
CLOSED_MM = 1e-3
"""Misfit below which a mechanism closes; steps also vanish at minima that are no assembly."""
STEP_MM = 30.0
"""Longest step of Newton's method, mm or mm at a lever."""
SAME_MM = 1e-3
"""Distance below which two poses are of one assembly."""
TINY = float(np.finfo(np.float64).tiny)
DIFFERENCE = 1e-5
"""Step of differences that derivatives of closures are compared with, mm or rad."""


@dataclass(frozen=True)
class ImplicitMechanism(Mechanism):
    """Mechanism that is stated by its closures: a subclass gives its fields and three functions.

    Example:
        >>> class Slide(ImplicitMechanism):
        ...     joint_kinds = ("prismatic",)
        ...     task_axes = POSITION[:1]
        ...     arm_fields = (ParameterField("joint_offset_mm", "offset, mm", "place", "offsets"),)
        ...
        ...     def misfit(self, fields, joints, pose):
        ...         return pose - joints
        ...
        ...     def first_joints(self, fields, poses):
        ...         return poses
        ...
        ...     def first_pose(self, fields, joints):
        ...         return joints
    """

    name: str
    rates: tuple[float, ...] = ()
    held_by_paper: tuple[str, ...] = ()
    reflector_mm: Place = (0.0, 0.0, 0.0)
    """Measured point seen from the controlled one, of a platform that is not turned."""
    home: tuple[float, ...] = ()
    """Pose well inside the workspace, (t,), mm and rad: the robot file's; () becomes 0."""

    joint_kinds: ClassVar[tuple[AxisKind, ...]]
    """Kind of each joint, (n,)."""
    task_axes: ClassVar[tuple[Axis, ...]]
    """Axes of the pose: `POSITION` or `PLANE`, then none, `TURN` or the three `TURNS`."""
    arm_fields: ClassVar[tuple[ParameterField, ...]]
    """Parameters of each arm, `joint_offset_deg` or `joint_offset_mm` among them; those in the
    other unit than the joint's are left out."""
    platform_fields: ClassVar[tuple[ParameterField, ...]] = ()
    lever_mm: ClassVar[float] = 100.0
    """Length at which a turn compares with a shift."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "rates", self._checked_rates())
        object.__setattr__(self, "home", self.home or (0.0,) * len(self.task))
        for arm, axis in enumerate(self.joints):
            if axis.kind not in get_args(AxisKind):
                raise ValueError(
                    f"joint_kinds of {self.name} have {axis.kind!r} for joint {arm}, must be "
                    f"{' or '.join(map(repr, get_args(AxisKind)))}"
                )
            offset = f"joint_offset_{axis.unit}"
            if offset not in {field.name for field in self.parameters.arm_fields(arm=arm)}:
                raise ValueError(f"arm_fields of {self.name} have no {offset} for joint {arm}")

    # --- what a mechanism states ----------------------------------------------------------------

    @abstractmethod
    def misfit(self, fields: Fields, joints: Array, pose: Array) -> Array:
        """Return by how much the mechanism does not close, (…, N, t), in mm or alike.

        `fields` hold the arms' parameters by stem, (…, 1, n), and the platform's, (…, 1, 1).
        `joints` (…, N, n) are with their offsets, `pose` (…, N, t) has the axes of `task_axes`. All
        may be complex: no `abs`, no `arctan2`, no comparison but of real parts.
        """

    @abstractmethod
    def first_joints(self, fields: Fields, poses: Array) -> Array:
        """Return the joints (N, n), with their offsets, of poses (N, t), or near them.

        NaN out of reach. The branch of the result is the robot's.
        """

    @abstractmethod
    def first_pose(self, fields: Fields, joints: Array) -> Array:
        """Return poses (N, t) near enough to the wanted assembly for Newton's method.

        `joints` (N, n) are with their offsets.
        """

    # A step into the imaginary direction passes through `abs` as if nothing moved. Only differences
    # show it, and every fit would be wrong.
    @np.errstate(all="ignore")
    def fault_of_closures(self, p: Array) -> str:
        """Return what is wrong with the three functions at the home pose; "" for nothing."""
        fields, size = self.fields_of(p), len(self._moving)
        home = self.home_poses(np.zeros((1, len(self.joint_kinds))))
        joints = np.asarray(self.first_joints(fields, home))
        if joints.shape != (1, len(self.joint_kinds)):
            return f"first_joints returns the shape {joints.shape}, must be (1, {len(self.joints)})"
        if not np.isfinite(joints).all():
            return "out of reach at home, the workspace's centre or the middle of the limits"
        pose = np.asarray(self.first_pose(fields, joints))
        if pose.shape != (1, size):
            return f"first_pose returns the shape {pose.shape}, must be (1, {size})"
        rows = np.asarray(self.misfit(fields, joints, pose))
        if rows.shape != (1, size) or not np.isfinite(rows).all():
            return f"misfit of the first pose is {rows.tolist()}, must be [{size} numbers]"
        for word, by_pose in (("pose", True), ("joints", False)):
            axes = np.eye(size if by_pose else joints.shape[1])[:, None]
            exact, ahead, back = (
                self.misfit(
                    fields,
                    np.asarray(joints if by_pose else joints + step * axes),
                    np.asarray(pose + step * axes if by_pose else pose),
                )
                for step in (1j * STEP, DIFFERENCE, -DIFFERENCE)
            )
            if np.shape(exact) != (wanted := (len(axes), 1, size)):
                return (
                    f"misfit of {len(axes)} changes of its {word} has the shape "
                    f"{np.shape(exact)}, must be {wanted}: np.hstack in it instead of closures?"
                )
            slopes = np.subtract(ahead, back) / (2.0 * DIFFERENCE)
            off = np.abs(np.imag(exact) / STEP - slopes).max()
            if not off < 1e-4 * (1.0 + np.abs(slopes).max()):
                return f"misfit loses the imaginary part of its {word}: abs or real in it?"
            if by_pose and np.linalg.matrix_rank(np.imag(exact)[:, 0] / STEP) < size:
                return "misfit leaves a motion of the platform free at home: a closure missing?"
        return ""

    # --- what follows ---------------------------------------------------------------------------

    @property
    @override
    def joints(self) -> tuple[Axis, ...]:
        return tuple(Axis(f"q{arm}", kind) for arm, kind in enumerate(self.joint_kinds))

    @cached_property
    def task(self) -> tuple[Axis, ...]:
        """Task axes: the stated ones, and a fixed z of a robot in a plane."""
        is_planar = self.task_axes[:3] != POSITION
        return (*self.task_axes[:2], FIXED_Z, *self.task_axes[2:]) if is_planar else self.task_axes

    @cached_property
    def _moving(self) -> list[int]:
        """Columns of a pose along which the platform moves: those of `task_axes`."""
        return [column for column, axis in enumerate(self.task) if not axis.is_fixed]

    # Ripples of rails repeat by a length and those of gears by a turn, but a table has one rate:
    # where a robot has joints of both kinds, only its gears ripple. No load enters the closures, so
    # that the drives' yield to it would be undetermined.
    @cached_property
    def parameters(self) -> ParameterTable:
        """Table of the parameters."""
        has_gears = "revolute" in self.joint_kinds
        arms = []
        for axis in self.joints:
            other = "mm" if axis.is_revolute else "deg"
            lacking = {f"{stem}_{other}" for stem in ("joint_offset", *transmission.STEMS)}
            lacking |= {"compliance_mm", "compliance_deg"}
            if has_gears and not axis.is_revolute:
                lacking |= {"ripple_sin_mm", "ripple_cos_mm"}
            fields = {field.name: field for field in self.arm_fields}  # gears and drives share some
            arms.append([field for name, field in fields.items() if name not in lacking])
        rate = RIPPLES_PER_TURN if has_gears else DRIVE_PERIOD
        return ParameterTable.of(arms, self.platform_fields, rate)

    # Fields that only some arms have are 0 of the others.
    @override
    def fields_of(self, p: Array) -> Fields:
        whole, rows = self.parameters.whole(p), self.parameters.rows
        fields = {}
        for stem, places in self._columns.items():
            arms = [rows[place].arm for place in places]
            if arms == [None]:
                fields[stem] = whole[places][None]
                continue
            fields[stem] = np.zeros((1, len(self.joint_kinds)))
            fields[stem][0, arms] = whole[places]
        return fields

    @override
    def placed(
        self, p: Array, plate_joints_mm: tuple[Place, ...] | None, reflector_mm: Place | None
    ) -> Self:
        return self if reflector_mm is None else replace(self, reflector_mm=reflector_mm)

    @override
    def with_home(self, pose: Array) -> Self:
        return replace(self, home=tuple(pose.tolist()))

    @override
    def home_at(self, place_mm: Sequence[float]) -> Array:
        pose = super().home_at(place_mm)
        pose[3:] = self.home[3:]
        return pose

    def home_poses(self, joints: Array) -> Array:
        """Return the home pose for each row of joints (N, n), by `task_axes`, to begin at."""
        return np.tile(np.array(self.home)[self._moving], (len(joints), 1))

    @override
    def points(self, poses: Array) -> Array:
        if len(self.task) == 3:
            return np.asarray(poses[:, :3] + np.array(self.reflector_mm))
        return np.asarray(poses[:, :3] + self._levers(poses))

    @override
    def point_rows(self, poses: Array, rows: Array) -> Array:
        if len(self.task) == 3:
            return rows[:, :3]
        levers, by_turn = self._levers(poses)[..., None], self.turn_rows(poses, rows)
        return np.asarray(rows[:, :3] + np.cross(by_turn, levers, axis=1))

    @override
    def facing(self, poses: Array, direction: Array) -> Array:
        if len(self.task) == 3:
            return direction
        home = self.tool_axes(np.array([self.home]))[0]
        return np.asarray(self.tool_axes(poses) @ (home.T @ direction))

    def _levers(self, poses: Array) -> Array:
        """Return the measured point seen from the controlled one, in the base frame, (N, 3)."""
        return np.asarray(self.tool_axes(poses) @ np.array(self.reflector_mm))

    def _closures(self, fields: Fields, true: Array, pose: Array) -> Array:
        """Return the misfits (…, N, t) at true joints less their offsets, (…, N, n)."""
        return np.asarray(self.misfit(fields, true + fields["joint_offset"], pose))

    def _by_pose(
        self, fields: Fields, true: Array, pose: Array, rows: Rows = ALL_ROWS
    ) -> tuple[Array, Array]:
        """Return closures (M, t) and their derivatives by poses (M, t, t), of true joints[rows]."""
        return _derivatives(self._closures(fields, true[rows], _stepped(pose)), pose.shape[1])

    def _by_joints(
        self, fields: Fields, pose: Array, true: Array, rows: Rows = ALL_ROWS
    ) -> tuple[Array, Array]:
        """Return closures (M, t) and their derivatives by joints (M, t, n), of poses[rows]."""
        return _derivatives(self._closures(fields, _stepped(true), pose[rows]), true.shape[1])

    # From poses nearby first, then rows that failed from the guess of the wanted assembly.
    @override
    def assemble(
        self, p: Array, joints: Array, near: Array | None = None, approach: Array | None = None
    ) -> Assembly:
        fields, moving = self.fields_of(p), self._moving
        true = self.true_joints_at(p, joints, approach)
        unknowns = np.empty((len(joints), len(moving)))
        is_solved = np.zeros(len(joints), dtype=bool)
        for nearby in (None,) if near is None else (near, None):
            rows = np.flatnonzero(~is_solved)
            if not len(rows):
                break
            of_rows = true[rows]
            if nearby is None:
                start = self.first_pose(fields, of_rows + fields["joint_offset"])
            else:
                start = nearby[rows][:, moving]
            unknowns[rows], is_solved[rows] = _solve_by_newton(
                partial(self._by_pose, fields, of_rows), start, self._levers_mm(self.task_axes)
            )
        poses = np.zeros((len(joints), len(self.task)))
        poses[:, moving] = unknowns
        poses[~is_solved] = np.nan
        return Assembly(poses, poses.copy(), self.points(poses), is_solved)

    @override
    def inverse(self, p: Array, poses: Array, approach: Array | None = None) -> tuple[Array, Mask]:
        fields = self.fields_of(p)
        poses = poses[:, self._moving]
        with np.errstate(invalid="ignore", divide="ignore"):
            start = self.first_joints(fields, poses) - fields["joint_offset"]
        joints, is_solved = _solve_by_newton(
            partial(self._by_joints, fields, poses), start, self._levers_mm(self.joints)
        )
        joints[~is_solved] = np.nan
        readings = transmission.encoder_readings(fields, joints, approach, self.phase_rate)
        return readings, is_solved

    def _levers_mm(self, axes: Sequence[Axis]) -> Array:
        """Return the factors (k,) that make changes along axes comparable lengths, mm."""
        return np.array([self.lever_mm if axis.is_revolute else 1.0 for axis in axes])

    # Poses compare as bodies do: two rotation vectors may be of one turn.
    @override
    def is_mode_of_home(self, p: Array, joints: Array, poses: Array) -> Mask:
        assembly = self.assemble(p, joints)
        away = np.abs(assembly.poses[:, :3] - poses[:, :3]).max(axis=1)
        turned = turn_between(self.tool_axes(assembly.poses), self.tool_axes(poses))
        away = np.maximum(away, self.lever_mm * np.abs(turned).max(axis=1))
        return np.asarray(assembly.is_solved & (away < SAME_MM))

    # Each parameter of each arm is stepped by itself: no structure of the closures is assumed.
    @override
    def jacobian(
        self, p: Array, joints: Array, poses: Array, approach: Array | None = None
    ) -> Array:
        fields, table, moving = self.fields_of(p), self.parameters, self._moving
        true, y = self.true_joints_at(p, joints, approach), poses[:, moving]
        by_closures = -np.linalg.inv(self._by_pose(fields, true, y)[1])
        columns = np.zeros((len(joints), len(moving), len(table.of_robot)))
        for stem, places in self._columns.items():
            if stem in transmission.STEMS:
                continue
            arms = [table.rows[place].arm or 0 for place in places]
            steps = 1j * STEP * np.eye(fields[stem].shape[1])[arms, None]
            stepped = {**fields, stem: fields[stem] + steps}
            by_field = self._closures(stepped, true[None], y[None]).imag / STEP
            by_field = np.broadcast_to(by_field, (len(arms), len(joints), len(moving)))
            columns[..., places] = by_closures @ np.moveaxis(by_field, 0, -1)
        by_offset = columns[..., table.columns["joint_offset"]]
        for stem, factor in transmission.terms(joints, approach, self.phase_rate).items():
            if stem in self._columns:
                places = self._columns[stem]
                arms = [table.rows[place].arm or 0 for place in places]
                columns[..., places] = (by_offset * factor[:, None])[..., arms]
        rows = np.zeros((len(joints), len(self.task), len(table.of_robot)))
        rows[:, moving] = columns
        return rows

    # Parts grow by their own lengths, the frame by the arms' places, and a leg or the scale of a
    # rail by where its joint stands: an offset moves as its joint does.
    @override
    def growth_columns(self, p: Array, by_p: Array, joints: Array) -> Array:
        table, whole = self.parameters, self.parameters.whole(p)
        grown = np.zeros((*by_p.shape[:2], 3))
        for place, group in ((1, "lengths"), (2, "places")):
            names = [name for name in table.select(group=group) if name in table.of_robot]
            rows = table.places(names)
            grown[..., place] = by_p[..., rows] @ whole[rows]
        slides = np.array([not axis.is_revolute for axis in self.joints])
        places = self._columns["joint_offset"]
        travel = (self.true_joints_at(p, joints) + whole[places]) * slides
        grown[..., 0] = np.einsum("nkj,nj->nk", by_p[..., places], travel)
        return grown

    # Turns compare with shifts at the lever at which they move the closures as much, on average: so
    # that a robot twice the size has the same margins. Where turns or a closure move nothing, the
    # singular value is 0.
    @override
    def margins(self, p: Array, joints: Array, poses: Array) -> Margins:
        fields, true = self.fields_of(p), self.true_joints_at(p, joints)
        value, has_joints = np.full(len(poses), np.nan), np.isfinite(joints).all(axis=1)
        of_rows = poses[has_joints][:, self._moving]
        _, by_pose = self._by_pose(fields, true[has_joints], of_rows)
        is_turn = np.array([axis.is_revolute for axis in self.task_axes])
        if is_turn.any():
            mean_squares = (by_pose**2).mean(axis=1)
            by_turn, by_place = mean_squares[:, is_turn], mean_squares[:, ~is_turn]
            lever_mm = np.sqrt(by_turn.mean(axis=1) / np.maximum(by_place.mean(axis=1), TINY))
            by_pose[..., is_turn] /= np.maximum(lever_mm, TINY)[:, None, None]
        by_pose /= np.maximum(np.linalg.norm(by_pose, axis=-1, keepdims=True), TINY)
        value[has_joints] = np.linalg.svd(by_pose, compute_uv=False)[:, -1]
        count = len(poses)
        return Margins(value, np.zeros((count, 0)), np.ones(count), np.zeros(count, dtype=np.bool_))


def closures(*parts: Array) -> Array:
    """Join closures, of which some may not depend on what is stepped.

    Args:
        parts: Closures (…, N, m), mm or alike; dimensions in front may differ.

    Returns:
        All closures as columns, (…, N, t).
    """
    shape = np.broadcast_shapes(*(part.shape[:-1] for part in parts))
    spread = [np.broadcast_to(part, (*shape, part.shape[-1])) for part in parts]
    return np.concatenate(spread, axis=-1)


def _stepped(values: Array) -> Array:
    """Return values (N, k) with a step of each column into the imaginary direction, (k, N, k)."""
    return np.asarray(values + 1j * STEP * np.eye(values.shape[1])[:, None])


def _derivatives(stepped: Array, count: int) -> tuple[Array, Array]:
    """Return closures (N, t) and derivatives (N, t, k) from closures (k, N, t) with steps."""
    stepped = np.broadcast_to(stepped, (count, *stepped.shape[-2:]))
    return stepped[0].real, np.moveaxis(stepped.imag, 0, -1) / STEP


# Newton's method with a limit of each step, so that a start far away is not thrown beyond its
# assembly. Rows that have arrived, or that are no longer finite, leave the batch. More unknowns
# than closures, of a robot with a redundant joint, take the shortest step.
@np.errstate(all="ignore")
def _solve_by_newton(
    differentiate: Callable[[Array, Index], tuple[Array, Array]], start: Array, levers_mm: Array
) -> tuple[Array, Mask]:
    """Return the unknowns (N, k) at which closures vanish, and which rows have converged.

    `differentiate` takes unknowns (M, k) of some rows and these rows, and returns the closures
    (M, t) and their derivatives (M, t, k). `start` is (N, k), `levers_mm` (k,).
    """
    unknowns, is_solved = start.copy(), np.zeros(len(start), dtype=bool)
    active = np.arange(len(start))
    for _ in range(MOST_ROUNDS):
        if not len(active):
            break
        residual, by_unknowns = differentiate(unknowns[active], active)
        usable = np.isfinite(residual).all(axis=1) & np.isfinite(by_unknowns).all(axis=(1, 2))
        active, residual, by_unknowns = active[usable], residual[usable], by_unknowns[usable]
        step = -_solved(by_unknowns / levers_mm, residual) / levers_mm
        size_mm = np.abs(step * levers_mm).max(axis=1)
        unknowns[active] += step / np.maximum(size_mm / STEP_MM, 1.0)[:, None]
        has_arrived = size_mm < CONVERGED_MM
        is_solved[active] = has_arrived & (np.abs(residual).max(axis=1) < CLOSED_MM)
        active = active[~has_arrived]
    return unknowns, is_solved


def _solved(matrices: Array, rows: Array) -> Array:
    """Return the shortest solutions (N, k) of matrices (N, t, k) for rows (N, t)."""
    if matrices.shape[1] == matrices.shape[2]:
        try:
            return np.asarray(np.linalg.solve(matrices, rows[..., None])[..., 0])
        except np.linalg.LinAlgError:  # a single singular one of them
            pass
    return np.asarray((np.linalg.pinv(matrices) @ rows[..., None])[..., 0])
