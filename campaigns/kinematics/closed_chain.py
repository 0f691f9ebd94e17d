"""Parallel mechanisms as closed chains of limbs under a plate: forward model, inverse, derivatives.

Each forearm is a parallelogram of two rods between an upper bar and a bar on the plate. With g the
vector from the middle of the upper bar to the middle of the plate's, and e the difference of the
two bars' unit vectors, the rods of arm i close where

    sum         (|g|² - L²) / 2L = 0        L: mean length of the two rods
    difference  g·e / L - κ = 0             κ: difference of the rods over the parallelogram's width

Unknown are y = (X, Y, Z[, θ]) and, of a robot with imperfect parts, the plate's small tilt ψ, a
rotation vector about the measured point. Perfect parts keep the plate level: then the sums alone
are solved. Three arms have as many closures as unknowns. Four have one more: all rods are taken as
equally stiff, which minimises the sum of squares and weights a difference by half the width.

`closures` says all this once, for level and tilted plates. Derivatives are complex steps of it,
except those of a level plate, which are the forearms' directions. Arm i's fields touch arm i's
closures alone, so one evaluation for a field serves all arms; the implicit function theorem makes
derivatives of the pose of them.

For given joints there is more than one real assembly. The wanted one hangs below its elbows, turns
less than the platform's limit, and has the sign of the closures' determinant that it has at home.
Newton alone ends on a wrong one for about one pose in a hundred, so each answer is checked, and
what fails is started again from other guesses.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from campaigns.arrays import Array, Index, Mask
from campaigns.kinematics import transmission
from campaigns.kinematics.axes import MM_PER_RAD, Axis
from campaigns.kinematics.limbs import STEP, Fields, Limb, dot, vectors
from campaigns.kinematics.parameters import ParameterTable, Role
from campaigns.kinematics.platforms import SAG, PlateGeometry, Platform, sag_basis

HALF_WIDTH_MM = 45.0
"""Half width of the parallelograms, which weights differences of rods: a drawing's value is near
enough (30 and 70 mm give the same poses within 0.2 µm)."""
CHUNK = 4096
"""Rows solved at a time, so that they stay in the processor's cache."""
ITERATIONS = 40
CONVERGED_MM = 1e-8
"""A Newton step shorter than this leaves an error of its square over the forearm's length."""
STEP_MM, TURN_STEP_MM = 120.0, 35.0
"""Longest steps of a search: of the position, and of the turn times its lever."""
TILTING = ("parallelogram_skew", "axis_tilt", "bar_turn")
WELL_BELOW_MM = 100.0
"""Height below the usual guess at which the assembly mode at home is read off."""
READ_ROUNDS = 30
READ_TO_MM = 1e-9
"""Distance of a pose reached from the pose wanted that ends these rounds; the last one leaves a
thousandth of it."""
GUESSES = ((0.0, 0.0), (0.6, -40.0), (-0.6, -40.0), (0.0, -150.0), (0.9, 60.0), (-0.9, 60.0),
           (0.0, 150.0))  # fmt: skip
"""Turn in rad and height in mm above the usual guess, tried in turn."""


@dataclass(frozen=True, eq=False)
class Geometry:
    """Parameters of one robot by field: of all arms (…, 1, n) by stem, and of the platform."""

    arms: Fields
    length: Array
    """Platform's own length, (…, 1, 1)."""
    sag: Array
    """Parameters of the sag, (4,)."""
    plate: PlateGeometry

    @property
    def tilts(self) -> bool:
        """Whether an imperfect part tilts the plate."""
        return any(self.arms[stem].any() for stem in TILTING)

    @property
    def compliance(self) -> Array:
        """Yield of joints to a load of 1, (1, n), rad or mm."""
        return self.arms["compliance"]


@dataclass(frozen=True, eq=False)
class Assembly:
    """Poses that joints assemble to."""

    unknowns: Array
    """Plate's pose, and its tilt where it tilts, (N, t) or (N, t + 3); NaN where not found."""
    poses: Array
    """(N, t)"""
    is_solved: Mask
    """(N,)"""


@dataclass(frozen=True)
class ClosedChain:
    """Mechanism of a kind of limb and a platform. It has no state: a robot is a vector p (P,)."""

    name: str
    limb: Limb
    platform: Platform
    held_by_paper: tuple[str, ...] = ()
    """Parameters, or fields of all arms, that the paper's method holds at nominal."""
    plate: PlateGeometry | None = None
    """Nominal places on the plate; None: typical ones."""
    rate: float = 0.0
    """How often the joints' ripples repeat, as `parameters.rate` has it; 0 if unknown."""
    controlled: Platform | None = None
    """Platform seen from the controlled point, where the reflector is on another part."""

    @property
    def joints(self) -> tuple[Axis, ...]:
        """Axes of the joints: `q0`, `q1` and so on."""
        return tuple(Axis(f"q{arm}", self.limb.joint) for arm in range(self.platform.arms))

    @property
    def task(self) -> tuple[Axis, ...]:
        """Task axes: x, y, z of the controlled point, and the turn if there is one."""
        return self.platform.task

    @cached_property
    def parameters(self) -> ParameterTable:
        """Table of the parameters."""
        platform, limb = self.platform, self.limb
        return ParameterTable.of(platform.arms, limb.fields, platform.fields, limb.rate)

    @cached_property
    def free_by_paper(self) -> tuple[str, ...]:
        """Names of the geometry that the paper's method fits."""
        table, held = self.parameters, set(self.held_by_paper)
        return tuple(name for name in table.names if not {name, table[name].field.name} & held)

    @property
    def phase_rate(self) -> float:
        """Phase of a ripple in rad over a reading in rad or mm."""
        in_mm = self.parameters.rate.unit == "mm"
        return 2.0 * np.pi / self.rate if in_mm and self.rate else self.rate

    def with_plate(self, plate: PlateGeometry) -> Self:
        """Return this mechanism with other places on the plate."""
        return replace(self, plate=plate)

    def with_ripples(self, rate: float) -> Self:
        """Return this mechanism with ripples that repeat as `parameters.rate` has it."""
        return replace(self, rate=rate)

    def seen_from(self, part: int | None) -> Self:
        """Return this mechanism with the measured point on part 1 or 2; None: as controlled.

        Parameters are the same: a frame takes up where on a part the point is.
        """
        point = self.controlled or self.platform
        if part is not None:
            seen = point.seen_from(part)
            return replace(self, platform=seen, controlled=None if seen == point else point)
        if self.controlled is None:
            return self
        plate = self.plate and replace(self.plate, reflector_mm=(0.0, 0.0, 0.0))
        return replace(self, platform=point, controlled=None, plate=plate)

    def geometry(self, p: Array) -> Geometry:
        """Sort a vector (P,) by fields; parameters beyond its end are 0."""
        whole = self.parameters.whole(p)
        named = {stem: whole[places][None] for stem, places in self._columns.items()}
        length = named.get(self._own_length, np.zeros((1, 1)))
        sag = np.concatenate([named[field.stem][0] for field in SAG])
        return Geometry(named, length, sag, self.plate or self._typical_plate(named))

    @cached_property
    def _columns(self) -> Mapping[str, Index]:
        """Places in a vector (P,) by stem."""
        size = len(self.parameters.of_robot)
        return {stem: own for stem, own in self.parameters.columns.items() if own[0] < size}

    @cached_property
    def _own_length(self) -> str:
        """Stem of the platform's own field: `plate`, `pinion`, or nothing."""
        stems = (f.stem for f in self.parameters.platform_fields())
        return next(stems, "")

    def _typical_plate(self, fields: Fields) -> PlateGeometry:
        outward = self.limb.outward_rad(fields).reshape(-1)
        return PlateGeometry.typical(outward, bars_follow_azimuths=self.limb.bars_follow_azimuths)

    # --- the closures and their derivatives ---------------------------------------------------

    def closures(self, geometry: Geometry, ends: Array, y: Array) -> Array:
        """Return by how much the rods do not close, (…, N, n) or (…, N, 2 n), in mm.

        `ends` (…, 3, N, n) are the forearms' upper ends, `y` (…, N, t) a level plate's pose or
        (…, N, t + 3) a tilted one's. Sums of all arms come first, then weighted differences.
        """
        fields, size = geometry.arms, len(self.task)
        forearm = self.lower_ends(geometry, y) - ends
        if y.shape[-1] == size:
            return _sums(forearm, fields["forearm"])
        tilt = as_vectors(y[..., size:])
        on_plate = self._offsets(geometry, y) + geometry.plate.from_reflector_mm
        forearm = forearm + rotation_less_identity(tilt, on_plate)
        fixed = geometry.plate.outward_rad
        across = fields["azimuth"] if fixed is None else np.array([fixed])
        turned = across + fields["bar_turn"]
        level = vectors(-np.sin(turned), np.cos(turned), 0.0)
        bars = level + rotation_less_identity(tilt, level) - self.limb.upper_bars(fields, across)
        differences = dot(forearm, bars) / fields["forearm"] - fields["parallelogram_skew"]
        return np.concatenate(
            [_sums(forearm, fields["forearm"]), HALF_WIDTH_MM * differences], axis=-1
        )

    def lower_ends(self, geometry: Geometry, y: Array) -> Array:
        """Return the lower ends of the forearms on a level plate, (…, 3, N, n)."""
        return as_vectors(y[..., :3]) + self._offsets(geometry, y)

    def _offsets(self, geometry: Geometry, y: Array) -> Array:
        """Return the lower ends of a level plate seen from the controlled point, (…, 3, N, n)."""
        turn = y[..., 3 : len(self.task)] if len(self.task) > 3 else np.zeros((1, 1))
        return self.platform.offsets(geometry.length, turn)

    def _by_unknowns(self, geometry: Geometry, ends: Array, y: Array) -> tuple[Array, Array]:
        """Return the closures (N, m) and their derivatives by y, (N, m, k).

        A level plate's closures change by its motion along the forearms.
        """
        if y.shape[1] > len(self.task):
            steps = STEP * np.eye(y.shape[1])[:, None]
            stepped = self.closures(geometry, ends, y + 1j * steps)
            return stepped[0].real, np.moveaxis(stepped.imag, 0, -1) / STEP
        forearm = self.lower_ends(geometry, y) - ends
        along_forearm = forearm / geometry.arms["forearm"]
        columns = [*along_forearm]
        if self.platform.has_two_parts:
            by_turn = self._offsets(geometry, np.asarray(y + 1j * STEP)).imag / STEP
            columns.append(dot(along_forearm, by_turn))
        return _sums(forearm, geometry.arms["forearm"]), np.stack(columns, axis=-1)

    def jacobian(
        self, p: Array, joints: Array, poses: Array, approach: Array | None = None
    ) -> Array:
        """Return d(pose)/dp (N, t, P) at fixed encoder readings (N, n), of the poses there.

        `poses` are (N, t), or the unknowns of an assembly, (N, t + 3). Raise `LinAlgError` at a
        singular pose.
        """
        geometry, table = self.geometry(p), self.parameters
        true, size = self.true_joints(geometry, joints, approach), len(self.task)
        loads = self._loads(geometry, true, poses[:, :size])
        true = true + geometry.compliance * loads
        ends = self.limb.upper_ends(geometry.arms, true)
        y = poses if poses.shape[1] > size else self._with_tilt(geometry, ends, poses)
        _, by_y = self._by_unknowns(geometry, ends, y)
        by_closures = _by_closures(by_y)[:, :size]
        columns = np.zeros((len(joints), size, len(table.of_robot)))
        by_fields = self._by_fields(geometry, true, y)
        for (
            stem,
            by_field,
        ) in by_fields.items():  # a field of arm i touches the closures of arm i alone
            both = by_closures * by_field[:, None]
            columns[..., self._columns[stem]] = both.reshape(*both.shape[:2], 2, -1).sum(axis=2)
        if self._own_length:
            longer = replace(geometry, length=np.asarray(geometry.length + 1j * STEP))
            by_length = self.closures(longer, ends, y).imag / STEP
            columns[..., self._columns[self._own_length]] = by_closures @ by_length[..., None]
        by_offset = columns[..., table.columns["joint_offset"]]
        for stem, factor in transmission.terms(joints, approach, self.phase_rate).items():
            if stem in self._columns:
                columns[..., self._columns[stem]] = by_offset * factor[:, None]
        columns[..., self._columns["compliance"]] = by_offset * loads[:, None]
        return self._with_sag(geometry, y, columns)

    def _by_fields(self, geometry: Geometry, joints: Array, y: Array) -> dict[str, Array]:
        """Return the derivatives of the closures (N, 2 n) by each field of their own arm."""
        stems = [f.stem for f in self.parameters.arm_fields(Role.GEOMETRY, Role.EXTENSION)]
        steps = 1j * STEP * np.eye(len(stems))[..., None, None]
        arms = {
            **geometry.arms,
            **{stem: geometry.arms[stem] + step for stem, step in zip(stems, steps, strict=True)},
        }
        ends = self.limb.upper_ends(arms, joints)
        stepped = self.closures(replace(geometry, arms=arms), ends, y).imag / STEP
        return dict(zip(stems, stepped, strict=True))

    def _loads(self, geometry: Geometry, joints: Array, y: Array) -> Array:
        """Return the loads (N, n) of joints by the plate's weight at poses (N, t) of a level plate.

        By virtual work a load is the weight times the plate's rise by the joint's motion; counted
        here as 1 at 300 mm a rad. Their change by yielding and by other parameters is left out: of
        0.2 mm it is 0.1 µm, and of derivatives 1 in 1000.
        """
        ends = self.limb.upper_ends(geometry.arms, joints)
        _, by_pose = self._by_unknowns(geometry, ends, y)
        moved = self.limb.upper_ends(geometry.arms, np.asarray(joints + 1j * STEP))
        by_joint = self.closures(geometry, moved, y).imag / STEP
        return np.asarray(
            _by_closures(by_pose)[:, 2] * by_joint * -self.joints[0].scale / MM_PER_RAD
        )

    def _with_sag(self, geometry: Geometry, y: Array, columns: Array) -> Array:
        """Add the sag's own columns to those of a plate that does not sag, and its slopes."""
        if geometry.sag.any():
            stepped = sag_basis(*(y[:, :3].T + 1j * STEP * np.eye(3)[:, :, None]).swapaxes(0, 1))
            slopes = np.einsum("s,skn->nk", geometry.sag, stepped.imag / STEP)
            columns[:, 2] += (slopes[:, None] @ columns[:, :3])[:, 0]
        for field, lifted in zip(SAG, sag_basis(*y[:, :3].T), strict=True):
            columns[:, 2, self._columns[field.stem][0]] = lifted
        return columns

    def growth_columns(self, p: Array, by_p: Array, joints: Array) -> Array:
        """Return ∂position (N, 3, 3) by the expansion of arms or rails, forearms, and frame.

        Each is the sum of lengths times the derivatives by them, `by_p` (N, 3, P). A rail carries
        its scale along; the frame grows from its origin to where the limbs are.
        """
        geometry, places = self.geometry(p), self._columns
        if "arm" in places:
            arms = by_p[..., places["arm"]] @ p[places["arm"]]
        else:
            travel = self.true_joints(geometry, joints) + p[places["joint_offset"]]
            arms = np.einsum("nkj,nj->nk", by_p[..., places["joint_offset"]], travel)
        forearms = by_p[..., places["forearm"]] @ p[places["forearm"]]
        on_plate = np.array(geometry.plate.joints_mm).T
        frame = sum(
            by_p[..., places[axis]] @ (p[places[axis]] + column)
            for axis, column in zip(("x", "y", "z"), on_plate, strict=True)
        )
        return np.stack([arms, forearms, frame], axis=2)

    # --- forward ------------------------------------------------------------------------------

    def assemble(
        self, p: Array, joints: Array, near: Array | None = None, approach: Array | None = None
    ) -> Assembly:
        """Solve for the poses of encoder readings (N, n).

        `near` (N, t) are poses close by, or an earlier assembly's unknowns (N, t + 3); without
        them, or where they lead nowhere, the search begins at guesses. `approach` (N, n) holds the
        signs of the joints' last motions.
        """
        geometry = self.geometry(p)
        true, size = self.true_joints(geometry, joints, approach), len(self.task)
        y = np.empty((len(joints), size + 3 if geometry.tilts else size))
        is_solved = np.empty(len(joints), dtype=bool)
        for first in range(0, len(joints), CHUNK):
            rows = slice(first, first + CHUNK)
            start = None if near is None else near[rows]
            y[rows], is_solved[rows] = self._assembled(geometry, true[rows], start)
        y[~is_solved] = np.nan
        return Assembly(y, self._sagged(geometry, y), is_solved)

    def _sagged(self, geometry: Geometry, y: Array) -> Array:
        """Return the poses (N, t) of a plate whose unknowns y (N, k) leave its sag out."""
        poses = y[:, : len(self.task)].copy()
        if geometry.sag.any():
            poses[:, 2] += geometry.sag @ sag_basis(*y[:, :3].T)
        return poses

    def _assembled(
        self, geometry: Geometry, joints: Array, near: Array | None
    ) -> tuple[Array, Mask]:
        """Solve one chunk: a level plate from each start until one is right, then tilt and load."""
        sign, size = self.assembly_sign(geometry), len(self.task)
        starts = [] if near is None else [near[:, :size]]
        ends = self.limb.upper_ends(geometry.arms, joints)
        y, is_solved = np.empty((len(joints), size)), np.zeros(len(joints), dtype=bool)
        for number in range(len(starts) + len(GUESSES)):
            rows = np.flatnonzero(~is_solved)
            if not len(rows):
                break
            if number < len(starts):
                start = starts[number]
            else:
                start = self._guess(geometry, ends[:, rows], *GUESSES[number - len(starts)])
            y[rows], settled = self._newton(geometry, ends[:, rows], start)
            wanted = self._is_wanted(geometry, ends[:, rows], y[rows], sign)
            is_solved[rows] = settled & wanted
        ends = ends[:, is_solved]
        if geometry.compliance.any():
            loads = self._loads(geometry, joints[is_solved], y[is_solved])
            yielded = joints[is_solved] + geometry.compliance * loads
            ends = self.limb.upper_ends(geometry.arms, yielded)
        if geometry.tilts:
            y = np.pad(y, ((0, 0), (0, 3)))
        if geometry.tilts or geometry.compliance.any():
            y[is_solved], is_solved[is_solved] = self._newton(geometry, ends, y[is_solved])
        return y, is_solved

    @np.errstate(divide="ignore", invalid="ignore", over="ignore")
    def _newton(self, geometry: Geometry, ends: Array, start: Array) -> tuple[Array, Mask]:
        """Return unknowns from starts (N, k) by limited Gauss-Newton steps, and which settled."""
        y, settled, size = start.copy(), np.zeros(len(start), dtype=bool), len(self.task)
        lever_mm, active = self._lever_mm(geometry), np.arange(len(start))
        for _ in range(ITERATIONS):
            step, misfit = self._gauss_newton_step(geometry, ends[:, active], y[active])
            way = np.abs(step[:, :3]).max(axis=1)
            turned = lever_mm * np.abs(step[:, 3:size]).sum(axis=1)
            shorter = np.maximum(np.maximum(way / STEP_MM, turned / TURN_STEP_MM), 1.0)
            y[active] += step / shorter[:, None]
            size_mm = way + turned + 50.0 * np.abs(step[:, size:]).sum(axis=1)
            # a minimum that leaves 1 mm is no assembly
            settled[active] = (size_mm < CONVERGED_MM) & (misfit < 1.0)
            active = active[(size_mm >= CONVERGED_MM) & np.isfinite(size_mm)]
            if not len(active):
                break
        return y, settled

    def _gauss_newton_step(self, geometry: Geometry, ends: Array, y: Array) -> tuple[Array, Array]:
        """Return the whole steps (N, k) from unknowns y, and the largest misfits there, mm."""
        residual, by_y = self._by_unknowns(geometry, ends, y)
        transposed = by_y.swapaxes(1, 2)
        normal = transposed @ by_y + 1e-14 * np.eye(y.shape[1])  # no exception where singular
        step = -np.linalg.solve(normal, transposed @ residual[..., None])[..., 0]
        return np.asarray(step), np.abs(residual[:, : ends.shape[2]]).max(axis=1)

    def _lever_mm(self, geometry: Geometry) -> float:
        """Return the lever that makes the platform's turn a length, for this robot's sizes."""
        forearm_mm = float(np.mean(geometry.arms["forearm"]))
        return self.platform.lever_mm(float(geometry.length[0, 0]), forearm_mm)

    def _guess(self, geometry: Geometry, ends: Array, turn_rad: float, lift_mm: float) -> Array:
        """Return poses (N, t) of a platform that hangs under the middle of its upper ends."""
        middle = ends.mean(axis=-1)
        outward2 = ((ends[:2] - middle[:2, :, None]) ** 2).sum(axis=0)
        drop = np.sqrt(np.maximum(geometry.arms["forearm"] ** 2 - outward2, 0.0).mean(axis=-1))
        aside = self.platform.offsets(geometry.length, np.array([[turn_rad]])).mean(axis=-1)
        pose = [middle[0] - aside[0], middle[1] - aside[1], middle[2] - drop + lift_mm]
        turns = [np.full_like(drop, turn_rad)] * (len(self.task) - 3)
        return np.stack([*pose, *turns], axis=1)

    def assembly_sign(self, geometry: Geometry) -> float:
        """Return the sign of the closures' determinant at home: joints 0, platform well below."""
        ends = self.limb.upper_ends(geometry.arms, np.zeros((1, self.platform.arms)))
        pose = self._guess(geometry, ends, 0.0, -WELL_BELOW_MM)
        _, by_pose = self._by_unknowns(geometry, ends, pose)
        return float(np.sign(np.linalg.det(by_pose))[0])

    @np.errstate(invalid="ignore", over="ignore")
    def _is_wanted(self, geometry: Geometry, ends: Array, poses: Array, sign: float) -> Mask:
        """Return which poses (N, t) hang below their upper ends, in the assembly mode of home."""
        _, by_pose = self._by_unknowns(geometry, ends, poses)
        wanted = (poses[:, 2] < ends[2].mean(axis=-1)) & (np.linalg.det(by_pose) * sign > 0.0)
        turned_over = np.abs(poses[:, 3:]) >= self.platform.turn_limit_rad
        return np.asarray(wanted & ~turned_over.any(axis=1))

    def _with_tilt(self, geometry: Geometry, ends: Array, poses: Array) -> Array:
        """Return the unknowns (N, t + 3) of poses (N, t) of forearms with these upper ends."""
        y = np.pad(poses, ((0, 0), (0, 3)))
        if geometry.sag.any():
            y[:, 2] -= geometry.sag @ sag_basis(*y[:, :3].T)
        return self._newton(geometry, ends, y)[0] if geometry.tilts else y

    # --- inverse --------------------------------------------------------------------------------

    def inverse(self, p: Array, poses: Array, approach: Array | None = None) -> tuple[Array, Mask]:
        """Return the encoder readings (N, n) of poses (N, t), and in which rows there are any.

        A level plate's joints follow directly. Where it tilts or sags, or joints yield, the target
        is moved against the difference between the pose wanted and the pose reached, until both
        agree.
        """
        geometry, goal = self.geometry(p), poses.copy()
        joints, is_solved = self._level_inverse(geometry, goal)
        is_level = not (geometry.tilts or geometry.compliance.any() or geometry.sag.any())
        y = np.pad(poses, ((0, 0), (0, 3))) if geometry.tilts else poses.copy()
        rows = np.flatnonzero(is_solved)
        for _ in range(0 if is_level else READ_ROUNDS):
            # one step of the forward model a round: both settle together
            true = joints[rows]
            if geometry.compliance.any():
                true = true + geometry.compliance * self._loads(geometry, true, goal[rows])
            ends = self.limb.upper_ends(geometry.arms, true)
            step, _ = self._gauss_newton_step(geometry, ends, y[rows])
            y[rows] += step
            error = poses[rows] - self._sagged(geometry, y[rows])
            goal[rows] += error
            joints[rows], held = self._level_inverse(geometry, goal[rows])
            is_solved[rows] = held & np.isfinite(error).all(axis=1)
            moving = np.maximum(np.abs(error).max(axis=1), np.abs(step).max(axis=1))
            rows = rows[is_solved[rows] & (moving > READ_TO_MM)]
            if not len(rows):
                break
        joints[~is_solved] = np.nan
        read = transmission.encoder_readings(geometry.arms, joints, approach, self.phase_rate)
        return read, is_solved

    def _level_inverse(self, geometry: Geometry, poses: Array) -> tuple[Array, Mask]:
        return self.limb.inverse(geometry.arms, self.lower_ends(geometry, poses))

    # --- singularities and transmission -------------------------------------------------------

    def singular_values(self, geometry: Geometry, ends: Array, poses: Array) -> Array:
        """Return the smallest singular value of the closures' Jacobian, (N,), of a level plate.

        Rows are of unit length, columns of angles divided by a lever first.
        """
        _, by_pose = self._by_unknowns(geometry, ends, poses)
        by_pose[..., 3:] /= self._lever_mm(geometry)
        by_pose /= np.linalg.norm(by_pose, axis=-1, keepdims=True)
        return np.asarray(np.linalg.svd(by_pose, compute_uv=False)[:, -1])

    def true_joints(
        self, geometry: Geometry, joints: Array, approach: Array | None = None
    ) -> Array:
        """Return where joints are, less their offsets, at encoder readings (N, n)."""
        return transmission.true_joints(geometry.arms, joints, approach, self.phase_rate)

    def steepest_error(self, p: Array) -> float:
        """Return a bound of the change of any joint's error over its motion."""
        fields = self.geometry(p).arms
        by_phase = {"backlash": 0.0, "ripple_sin": self.phase_rate, "ripple_cos": self.phase_rate}
        bounds = [
            abs(by_phase.get(stem, 1.0)) * np.abs(fields[stem])
            for stem in transmission.STEMS
            if stem in fields
        ]
        return float(np.sum(bounds, axis=0).max())

    def joint_slopes(self, p: Array, joints: Array) -> Array:
        """Return the change of true joints over that of encoder readings (N, n), (N, n)."""
        stepped = self.true_joints(self.geometry(p), np.asarray(joints + 1j * STEP))
        return np.asarray(stepped.imag / STEP)


def _sums(forearm: Array, forearm_mm: Array) -> Array:
    return np.asarray((dot(forearm, forearm) - forearm_mm**2) / (2.0 * forearm_mm))


def _by_closures(by_y: Array) -> Array:
    """Return the derivatives of the unknowns by the closures, (N, k, m), from (N, m, k)."""
    transposed = by_y.swapaxes(1, 2)
    return np.asarray(-np.linalg.solve(transposed @ by_y, transposed))


def rotation_less_identity(rotation: Array, vectors: Array) -> Array:
    """Return (R - 1) v to second order of a rotation vector: 0.01 rad over 60 mm leave 10 nm."""
    first = cross(rotation, vectors)
    return np.asarray(first + 0.5 * cross(rotation, first))


def cross(a: Array, b: Array) -> Array:
    """Return vector products of vectors (…, 3, N, n)."""
    (ax, ay, az), (bx, by, bz) = ([v[..., k, :, :] for k in range(3)] for v in (a, b))
    return vectors(ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx)


def as_vectors(rows: Array) -> Array:
    """Return rows (…, N, 3) as vectors that all arms share, (…, 3, N, 1)."""
    return rows.swapaxes(-1, -2)[..., None]
