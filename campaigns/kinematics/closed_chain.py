"""Parallel mechanisms as closed chains of limbs under a plate: forward model, inverse, derivatives.

Theory of operation. Each forearm is a parallelogram of two rods between an upper bar and a bar on
the plate. With g the vector from the middle of the upper bar to the middle of the plate's bar, and
e the difference of the two bars' unit vectors, the rods of arm i close where

    sum         (|g|² - L²) / 2L = 0        L: mean length of the two rods
    difference  g·e / L - κ = 0             κ: difference of the rods over the parallelogram's width

Unknown are y = (X, Y, Z[, θ]) and, of a robot with imperfect parts, the plate's small tilt ψ, a
rotation vector about the measured point. Perfect parts keep the plate level: then the sums alone
are solved. Three arms have 6 closures for 6 unknowns. Four arms have 8 for 7: all rods are taken as
equally stiff, which minimises the sum of squares. `closures` states these equations once. From them
follow the forward model (`assemble`), the inverse model (`inverse`) and derivatives (`jacobian`).
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self, TypeAlias

import numpy as np
from typing_extensions import override

from campaigns.arrays import Array, Mask
from campaigns.kinematics import transmission
from campaigns.kinematics.axes import MM_PER_RAD, Axis
from campaigns.kinematics.limbs import STEP, Fields, Limb, dot, vectors
from campaigns.kinematics.mechanism import Assembly, Margins, Mechanism
from campaigns.kinematics.parameters import ParameterTable, Role
from campaigns.kinematics.platforms import REFLECTOR, SAG, Place, PlateGeometry, Platform, sag_basis

HALF_WIDTH_MM = 45.0
"""Half width of the parallelograms, which weights differences of rods. The value of a drawing is
accurate enough: 30 and 70 mm give the same poses within 0.2 µm."""
CHUNK = 4096
"""Rows solved at a time, so that they stay in the processor's cache."""
MOST_ITERATIONS = 20
CONVERGED_MM = 1e-8
"""Step of the search below which a pose has been reached."""
STEP_MM, TURN_STEP_MM = 120.0, 35.0
"""Longest steps of a search: of the position, and of the turn times its lever."""
TILTING = ("parallelogram_skew", "axis_tilt", "bar_turn")
"""Stems of the fields that tilt the plate where they are not 0."""
WELL_BELOW_MM = 100.0
"""Height below the usual guess at which the assembly mode at home is read off."""
MOST_INVERSE_ROUNDS = 30
INVERSE_ERROR_MM = 1e-9
"""Distance of a pose reached from the pose wanted that ends these rounds."""
GUESSES = ((0.0, 0.0), (0.6, -40.0), (-0.6, -40.0), (0.9, 60.0), (-0.9, 60.0))
"""Turns in rad and heights in mm above the usual guess, in the order in which they are tried."""

Row: TypeAlias = tuple[Array, Array, Array]
Matrix: TypeAlias = tuple[Row, Row, Row]
"""Matrices of all rows: each component is an array (…, N, 1)."""


@dataclass(frozen=True, eq=False)
class Geometry:
    """Parameters of one robot by field: of all arms (…, 1, n) by stem, and of the platform."""

    arms: Fields
    length: Array
    """Platform's own length, (…, 1, 1): `plate_mm`, `pinion_mm`, or 0."""
    sag: Array
    """Parameters of the sag, (4,)."""
    plate: PlateGeometry

    @property
    def tilts(self) -> bool:
        """Whether an imperfect part of an arm (`TILTING`) tilts the plate."""
        return any(self.arms[stem].any() for stem in TILTING)

    @property
    def plate_joints_mm(self) -> Array:
        """Plate joints seen from where the contracted model has them, (…, 3, 1, n)."""
        beyond = (self.arms[f"plate_joint_{c}"] for c in "xyz")
        return np.array(self.plate.joints_mm).T[:, None] + vectors(*beyond)

    @property
    def reflector_mm(self) -> Array:
        """Measured point seen from the controlled one, (3, 1, 1)."""
        if self.plate.reflector_mm is None:
            return np.zeros((3, 1, 1))
        beyond = np.stack([self.arms[field.stem] for field in REFLECTOR])
        return np.asarray(np.reshape(self.plate.reflector_mm, (3, 1, 1)) + beyond)

    @property
    def compliance(self) -> Array:
        """Yield of each joint to a load of 1, (1, n), rad or mm."""
        return self.arms["compliance"]


@dataclass(frozen=True)
class ClosedChain(Mechanism):
    """Mechanism of a kind of limb and a platform. It has no state: a robot is a vector p (P,)."""

    name: str
    limb: Limb
    platform: Platform
    held_by_paper: tuple[str, ...] = ()
    plate: PlateGeometry | None = None
    """Nominal places on the plate; None: typical ones."""
    rates: tuple[float, ...] = ()
    controlled: Platform | None = None
    """Platform seen from the controlled point; None: `platform` is, for the reflector is there."""

    has_forearms = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "rates", self._checked_rates())

    @property
    @override
    def joints(self) -> tuple[Axis, ...]:
        return tuple(Axis(f"q{arm}", self.limb.joint) for arm in range(self.platform.arms))

    @property
    @override
    def task(self) -> tuple[Axis, ...]:
        return self.platform.task

    @cached_property
    def parameters(self) -> ParameterTable:
        """Table of the parameters."""
        platform, limb = self.platform, self.limb
        return ParameterTable.of((limb.fields,) * platform.arms, platform.fields, limb.rate)

    def with_plate(self, plate: PlateGeometry) -> Self:
        """Return this mechanism with other places on the plate."""
        return replace(self, plate=plate)

    @override
    def placed(
        self, p: Array, plate_joints_mm: tuple[Place, ...] | None, reflector_mm: Place | None
    ) -> Self:
        typical = self.geometry(p).plate
        joints_mm = plate_joints_mm or typical.joints_mm
        reflector_mm = reflector_mm or typical.reflector_mm
        return self.with_plate(replace(typical, joints_mm=joints_mm, reflector_mm=reflector_mm))

    # Parameters do not change: a level part only translates, so that the place of the point on its
    # part is a constant vector, which the frame of the measurements absorbs.
    @override
    def seen_from(self, part: int | None) -> Self:
        controlled = self.controlled or self.platform
        if part is not None:
            measured = controlled.seen_from(part)
            other = None if measured == controlled else controlled
            return replace(self, platform=measured, controlled=other)
        if self.controlled is None:
            return self
        plate = self.plate and replace(self.plate, reflector_mm=None)
        return replace(self, platform=controlled, controlled=None, plate=plate)

    @override
    def body(self, part: int | None) -> Self:
        seen = self.seen_from(part)
        return replace(seen, plate=seen.plate and replace(seen.plate, reflector_mm=None))

    # A point is modelled as X + (A - 1) r of its place r on the plate with axes A, not as X + A r.
    @override
    def reflector_in_frames(self, p: Array) -> tuple[Array, Array]:
        geometry, by_p = self.geometry(p), np.zeros((3, len(p)))
        if geometry.plate.reflector_mm is not None:
            for row, c in enumerate("xyz"):
                by_p[row, self._columns[f"reflector_{c}"]] = 1.0
        return geometry.reflector_mm[:, 0, 0], by_p

    @property
    @override
    def out_of_reach(self) -> str:
        return f"out of reach: a forearm cannot span from {self.limb.words[0]} to the plate"

    @property
    @override
    def words_of_swing(self) -> tuple[str, str]:
        return self.limb.words[1:]

    @property
    @override
    def halves(self) -> tuple[int | None, ...]:
        controlled = self.controlled or self.platform
        if not controlled.has_two_parts:
            return ()
        # A Par4's controlled point is on half 1, so that only the halves differ; an H4's is in the
        # middle of the crossbar, a third place (None).
        parts = (1, 2) if controlled.arms_at_point else (None, 1, 2)
        return tuple(part for part in parts if self.seen_from(part).platform != self.platform)

    @property
    @override
    def is_between_halves(self) -> bool:
        return not self.platform.arms_at_point

    @property
    @override
    def is_elsewhere(self) -> bool:
        return self.controlled is not None

    @override
    def fields_of(self, p: Array) -> Fields:
        return self.geometry(p).arms

    def geometry(self, p: Array) -> Geometry:
        """Sort a vector (P,) by fields; parameters beyond its end are 0."""
        whole = self.parameters.whole(p)
        named = {stem: whole[places][None] for stem, places in self._columns.items()}
        length = named.get(self._length_stem, np.zeros((1, 1)))
        sag = np.concatenate([named[field.stem][0] for field in SAG])
        return Geometry(named, length, sag, self.plate or self._typical_plate(named))

    @cached_property
    def _length_stem(self) -> str:
        """Stem of the platform's length: `plate`, `pinion`, or "" for a point."""
        stems = (field.stem for field in self.parameters.platform_fields())
        return next(stems, "")

    def _typical_plate(self, fields: Fields) -> PlateGeometry:
        outward = self.limb.outward_rad(fields).reshape(-1)
        return PlateGeometry.typical(outward, bars_follow_azimuths=self.limb.bars_follow_azimuths)

    # --- the closures and their derivatives ---------------------------------------------------
    #
    # With half width b, the rods of an arm are the vectors g ± b e, and their lengths L ± b κ:
    #
    #     |g ± b e|² = (L ± b κ)²
    #
    # Half the sum of both equations is |g|² = L², half their difference g·e = κ L. The sum leaves
    # out b² (|e|² - κ²), which is of second order: 1e-5 mm of rod where parts are off by 2 mrad.
    # If s is the sum's misfit and d the difference's, the two rods misfit by s ± b d. Equal rods
    # take equal parts of it, and (s + b d)² + (s - b d)² = 2 (s² + (b d)²): hence the weight b.

    def closures(self, geometry: Geometry, upper_ends: Array, y: Array) -> Array:
        """Return by how much the rods do not close, (…, N, n) or (…, N, 2 n), in mm.

        `upper_ends` (…, 3, N, n) are those of the forearms, `y` (…, N, t) a level plate's pose or
        (…, N, t + 3) a tilted one's. Sums of all arms come first, then weighted differences.
        """
        if y.shape[-1] == len(self.task):
            forearms = self.lower_ends(geometry, y) - upper_ends
            return _sum_closures(forearms, geometry.arms["forearm"])
        return _tilted_closures(geometry, *self._rods(geometry, upper_ends, y))

    def _rods(self, geometry: Geometry, upper_ends: Array, y: Array) -> tuple[Array, Array]:
        """Return the vectors g and e, (…, 3, N, n), at unknowns y (…, N, t + 3)."""
        # the tilt turns the plate about the measured point, and its joints and bars with it
        fields, tilt = geometry.arms, rotation_less_identity(as_vectors(y[..., len(self.task) :]))
        offsets = self._offsets(geometry, y)
        on_plate = offsets + geometry.plate_joints_mm - geometry.reflector_mm
        lower_ends = as_vectors(y[..., :3]) + offsets
        outward = geometry.plate.outward_rad
        bar_azimuths = fields["azimuth"] if outward is None else np.array([outward])
        turned = bar_azimuths + fields["bar_turn"]
        level_bars = vectors(-np.sin(turned), np.cos(turned), 0.0)
        lower_bars = level_bars + product(tilt, level_bars)
        forearms = lower_ends + product(tilt, on_plate) - upper_ends
        return forearms, lower_bars - self.limb.upper_bars(fields, bar_azimuths)

    def lower_ends(self, geometry: Geometry, y: Array) -> Array:
        """Return the lower ends of the forearms on a level plate, (…, 3, N, n)."""
        return as_vectors(y[..., :3]) + self._offsets(geometry, y)

    def _offsets(self, geometry: Geometry, y: Array) -> Array:
        """Return the lower ends of a level plate seen from the controlled point, (…, 3, N, n)."""
        turn = y[..., 3 : len(self.task)] if len(self.task) > 3 else np.zeros((1, 1))
        return self.platform.offsets(geometry.length, turn)

    # By the place X derivatives are known in closed form: ∂s/∂X = g / L, the forearm's direction,
    # and ∂d/∂X = e / L of the difference d; of a level plate ∂s/∂θ = (g / L)·∂B/∂θ with the lower
    # end B. A tilted plate's turn and tilt are stepped into the imaginary direction instead:
    # F(y + ih) = F(y) + ih F'(y), exact to rounding for h = 1e-200 (Squire and Trapp 1998). All of
    # these save the cancellation of differences.
    def _differentiate_by_unknowns(
        self, geometry: Geometry, upper_ends: Array, y: Array
    ) -> tuple[Array, Array]:
        """Return the closures (N, m) and their derivatives by y, (N, m, k)."""
        if y.shape[1] > len(self.task):
            steps = 1j * STEP * np.eye(y.shape[1])[3:, None]
            forearms, bars = self._rods(geometry, upper_ends, y + steps)
            stepped = _tilted_closures(geometry, forearms, bars)
            by_place = np.concatenate([forearms[0].real, HALF_WIDTH_MM * bars[0].real], axis=-1)
            by_place = by_place / np.tile(geometry.arms["forearm"], 2)
            by_y = np.concatenate([by_place, stepped.imag / STEP])
            return stepped[0].real, np.moveaxis(by_y, 0, -1)
        forearms = self.lower_ends(geometry, y) - upper_ends
        directions = forearms / geometry.arms["forearm"]
        columns = [*directions]
        if self.platform.has_two_parts:
            by_turn = self._offsets(geometry, np.asarray(y + 1j * STEP)).imag / STEP
            columns.append(dot(directions, by_turn))
        return _sum_closures(forearms, geometry.arms["forearm"]), np.stack(columns, axis=-1)

    # Implicit function theorem: the closures F(y, p) stay 0 at fixed joints, so that
    #
    #     dy/dp = -F_y⁺ F_p          F_y⁺ = (F_y' F_y)⁻¹ F_y'
    #
    # Of a tilted plate on four arms F_y has one row more than columns: the pseudo-inverse F_y⁺ then
    # leaves out the curvature of rods that do not quite close.
    #
    # 1. Joints with their yield, and the unknowns of a tilted plate: also where this robot's parts
    #    are perfect, for the derivatives by imperfections are not 0 there.
    # 2. Fields of an arm enter the closures of that arm alone. One evaluation with the fields of
    #    all arms stepped at once therefore gives the derivatives by n parameters.
    # 3. The platform's length enters all closures: an evaluation of its own.
    # 4. Only differences of places on the plate matter: a shift of the reflector acts like the
    #    opposite shift of all plate joints.
    # 5. Errors of the transmission act like the joint's offset, each times its factor.
    #
    # Left out are the change of the weight's loads with the pose and, of four arms, the curvature
    # of rods that do not close: less than 1 % with parts at two tolerances.
    @override
    def jacobian(
        self, p: Array, joints: Array, poses: Array, approach: Array | None = None
    ) -> Array:
        return self._jacobian(p, joints, poses, approach)[:, : len(self.task)]

    # The tool turns by the plate's tilt ψ and by θ about the plate's z: ω = dψ + z dθ but for
    # products with the tilt.
    @override
    def turn_jacobian(
        self, p: Array, joints: Array, unknowns: Array, approach: Array | None = None
    ) -> Array:
        size = len(self.task)
        rows = self._jacobian(p, joints, unknowns, approach, with_tilt=True)
        turns = rows[:, size:].copy()
        turns[:, 2] += rows[:, 3:size].sum(axis=1)
        return turns

    def _jacobian(
        self,
        p: Array,
        joints: Array,
        poses: Array,
        approach: Array | None,
        *,
        with_tilt: bool = False,
    ) -> Array:
        """Return the derivatives (N, t, P) of poses, or of poses and tilt, (N, t + 3, P)."""
        geometry, table = self.geometry(p), self.parameters
        true, task_size = self.true_joints(geometry, joints, approach), len(self.task)
        loads = self._weight_loads(geometry, true, poses[:, :task_size])
        true = true + geometry.compliance * loads
        upper_ends = self.limb.upper_ends(geometry.arms, true)
        has_tilt = poses.shape[1] > task_size
        y = poses if has_tilt else self._append_tilt(geometry, upper_ends, poses)
        if with_tilt and y.shape[1] == task_size:
            y = np.pad(y, ((0, 0), (0, 3)))
        _, by_unknowns = self._differentiate_by_unknowns(geometry, upper_ends, y)
        by_closures = _unknowns_by_closures(by_unknowns)[:, : None if with_tilt else task_size]

        columns = np.zeros((*by_closures.shape[:2], len(table.of_robot)))
        for stem, by_field in self._differentiate_by_fields(geometry, true, y).items():
            both = by_closures * by_field[:, None]  # (N, k, 2 n): sum and difference of each arm
            parts = both.reshape(*both.shape[:2], 2, self.platform.arms)
            columns[..., self._columns[stem]] = parts.sum(axis=2)

        if self._length_stem:
            longer = replace(geometry, length=np.asarray(geometry.length + 1j * STEP))
            by_length = self.closures(longer, upper_ends, y).imag / STEP
            columns[..., self._columns[self._length_stem]] = by_closures @ by_length[..., None]

        if geometry.plate.reflector_mm is not None:
            for c in "xyz":
                by_joints = columns[..., self._columns[f"plate_joint_{c}"]]
                columns[..., self._columns[f"reflector_{c}"][0]] = -by_joints.sum(axis=2)

        by_offset = columns[..., table.columns["joint_offset"]]
        for stem, factor in transmission.terms(joints, approach, self.phase_rate).items():
            if stem in self._columns:
                columns[..., self._columns[stem]] = by_offset * factor[:, None]
        columns[..., self._columns["compliance"]] = by_offset * loads[:, None]
        return self._add_sag(geometry, y, columns)

    def _differentiate_by_fields(
        self, geometry: Geometry, joints: Array, y: Array
    ) -> dict[str, Array]:
        """Return the derivatives of the closures (N, 2 n) by each field of their own arm."""
        fields = self.parameters.arm_fields(Role.GEOMETRY, Role.EXTENSION)
        stems = [field.stem for field in fields]
        # step k is imaginary in field k alone: the leading axis counts them
        steps = 1j * STEP * np.eye(len(stems))[..., None, None]
        stepped_fields = {
            stem: geometry.arms[stem] + step for stem, step in zip(stems, steps, strict=True)
        }
        arms = {**geometry.arms, **stepped_fields}
        upper_ends = self.limb.upper_ends(arms, joints)
        stepped = self.closures(replace(geometry, arms=arms), upper_ends, y).imag / STEP
        return dict(zip(stems, stepped, strict=True))

    # Virtual work: at equilibrium the moment of joint i balances the weight times dz/dq_i, the
    # plate's rise by that joint's motion, dz/dq_i = -(F_y⁺ F_q)_zi. The weight itself is unknown
    # and part of the parameter: a load counts as 1 where the joint lowers the plate by 300 mm a
    # rad, or by 1 mm a mm. Loads are those before the joints yield.
    def _weight_loads(self, geometry: Geometry, joints: Array, y: Array) -> Array:
        """Return the loads (N, n) of joints by the plate's weight, at poses y (N, t), level."""
        upper_ends = self.limb.upper_ends(geometry.arms, joints)
        _, by_pose = self._differentiate_by_unknowns(geometry, upper_ends, y)
        stepped_ends = self.limb.upper_ends(geometry.arms, np.asarray(joints + 1j * STEP))
        by_joint = self.closures(geometry, stepped_ends, y).imag / STEP
        rise_by_joint = _unknowns_by_closures(by_pose)[:, 2] * by_joint
        return np.asarray(-rise_by_joint * self.joints[0].scale / MM_PER_RAD)

    # With the pose x of a plate without sag, the sagging plate's height is z + f(x; s), where f is
    # linear in the parameters s. Derivatives by other parameters gain (∂f/∂x) dx/dp in the row of
    # z, those by s are f's basis itself.
    def _add_sag(self, geometry: Geometry, y: Array, columns: Array) -> Array:
        """Add the sag's slopes to the columns (N, t, P) of a plate without it, and its columns."""
        position = y[:, :3].T
        if geometry.sag.any():
            steps = 1j * STEP * np.eye(3)[:, :, None]
            stepped = sag_basis(*(position + steps).swapaxes(0, 1))
            slopes = np.einsum("s,skn->nk", geometry.sag, stepped.imag / STEP)
            columns[:, 2] += (slopes[:, None] @ columns[:, :3])[:, 0]
        for field, rise in zip(SAG, sag_basis(*position), strict=True):
            columns[:, 2, self._columns[field.stem][0]] = rise
        return columns

    # A warm part is longer by the ratio γ (T - T0) in all its lengths: ∂X/∂γ = Σ length ∂X/∂length.
    # Rails carry their scale along, so that a carriage's travel grows instead of an arm. The frame
    # grows from its origin to the motors: P of the model is the motor's place less its plate
    # joint's, so the plate joint's place is added again.
    @override
    def growth_columns(self, p: Array, by_p: Array, joints: Array) -> Array:
        geometry, places = self.geometry(p), self._columns
        if "arm" in places:
            arms = by_p[..., places["arm"]] @ p[places["arm"]]
        else:
            travel = self.true_joints(geometry, joints) + p[places["joint_offset"]]
            arms = np.einsum("nkj,nj->nk", by_p[..., places["joint_offset"]], travel)
        forearms = by_p[..., places["forearm"]] @ p[places["forearm"]]
        on_plate = geometry.plate_joints_mm[:, 0]
        frame = sum(
            by_p[..., places[axis]] @ (p[places[axis]] + column)
            for axis, column in zip(("x", "y", "z"), on_plate, strict=True)
        )
        return np.stack([arms, forearms, frame], axis=2)

    # --- forward ------------------------------------------------------------------------------

    @override
    def assemble(
        self, p: Array, joints: Array, near: Array | None = None, approach: Array | None = None
    ) -> Assembly:
        geometry = self.geometry(p)
        true, task_size = self.true_joints(geometry, joints, approach), len(self.task)
        y = np.empty((len(joints), task_size + 3 if geometry.tilts else task_size))
        is_solved = np.empty(len(joints), dtype=bool)
        for first in range(0, len(joints), CHUNK):
            rows = slice(first, first + CHUNK)
            start = None if near is None else near[rows]
            y[rows], is_solved[rows] = self._assemble_chunk(geometry, true[rows], start)
        y[~is_solved] = np.nan
        poses = self._poses_with_sag(geometry, y)
        return Assembly(y, poses, self.points(poses), is_solved)

    def _poses_with_sag(self, geometry: Geometry, y: Array) -> Array:
        """Return the poses (N, t) of a plate whose unknowns y (N, k) leave its sag out."""
        poses = y[:, : len(self.task)].copy()
        if geometry.sag.any():
            poses[:, 2] += geometry.sag @ sag_basis(*y[:, :3].T)
        return poses

    # For one set of joints there is more than one real assembly. The wanted one hangs below its
    # elbows, turns less than the platform's limit, and has the sign of the closures' determinant
    # that the robot has at home. Newton's method alone ends on a wrong assembly for about one pose
    # in a hundred.
    # 1. Solve a level plate from the pose nearby, then rows that failed from one guess after the
    #    other, until each has the wanted assembly or no guess is left.
    # 2. Let joints yield to the plate's weight at the poses found.
    # 3. Solve once more from these poses, now with the yielded joints and with the tilt.
    def _assemble_chunk(
        self, geometry: Geometry, joints: Array, near: Array | None
    ) -> tuple[Array, Mask]:
        """Return the unknowns (N, k) of one chunk of joints (N, n), and which rows are solved."""
        sign, task_size = self.assembly_sign(geometry), len(self.task)
        upper_ends = self.limb.upper_ends(geometry.arms, joints)
        y, is_solved = np.empty((len(joints), task_size)), np.zeros(len(joints), dtype=bool)
        for guess in (None, *GUESSES):
            rows = np.flatnonzero(~is_solved)
            if not len(rows):
                break
            ends = upper_ends[:, rows]
            if guess is not None:
                start = self._guess_poses(geometry, ends, *guess)
            elif near is not None:
                start = near[rows, :task_size]
            else:
                continue
            y[rows], has_converged = self._solve_by_newton(geometry, ends, start)
            is_solved[rows] = has_converged & self._is_wanted(geometry, ends, y[rows], sign)
        upper_ends = upper_ends[:, is_solved]
        if geometry.compliance.any():
            loads = self._weight_loads(geometry, joints[is_solved], y[is_solved])
            yielded = joints[is_solved] + geometry.compliance * loads
            upper_ends = self.limb.upper_ends(geometry.arms, yielded)
        if geometry.tilts:
            y = np.pad(y, ((0, 0), (0, 3)))
        if geometry.tilts or geometry.compliance.any():
            again = self._solve_by_newton(geometry, upper_ends, y[is_solved])
            y[is_solved], is_solved[is_solved] = again
        return y, is_solved

    # Gauss-Newton with a limit of each step, so that a start far away is not thrown beyond its
    # assembly. Rows that have arrived leave the batch. A row has arrived if its step is below
    # 1e-8 mm and its sums close within 1 mm: the squares of the misfits have minima that are no
    # assembly, where the step vanishes but the rods stay apart by many mm.
    @np.errstate(divide="ignore", invalid="ignore", over="ignore")
    def _solve_by_newton(
        self, geometry: Geometry, upper_ends: Array, start: Array
    ) -> tuple[Array, Mask]:
        """Return the unknowns (N, k) that starts (N, k) lead to, and which rows have converged."""
        y, has_converged = start.copy(), np.zeros(len(start), dtype=bool)
        lever_mm, task_size = self._lever_mm(geometry), len(self.task)
        active = np.arange(len(start))
        for _ in range(MOST_ITERATIONS):
            step, misfit_mm = self._gauss_newton_step(geometry, upper_ends[:, active], y[active])
            shift_mm = np.abs(step[:, :3]).max(axis=1)
            turn_mm = lever_mm * np.abs(step[:, 3:task_size]).sum(axis=1)
            tilt_mm = 50.0 * np.abs(step[:, task_size:]).sum(axis=1)  # at about a plate's radius
            shorten = np.maximum(np.maximum(shift_mm / STEP_MM, turn_mm / TURN_STEP_MM), 1.0)
            y[active] += step / shorten[:, None]
            size_mm = shift_mm + turn_mm + tilt_mm
            has_converged[active] = (size_mm < CONVERGED_MM) & (misfit_mm < 1.0)
            active = active[(size_mm >= CONVERGED_MM) & np.isfinite(size_mm)]
            if not len(active):
                break
        return y, has_converged

    def _gauss_newton_step(
        self, geometry: Geometry, upper_ends: Array, y: Array
    ) -> tuple[Array, Array]:
        """Return the steps -F_y⁺ F (N, k) from unknowns y, and the largest misfits there, mm."""
        residual, by_y = self._differentiate_by_unknowns(geometry, upper_ends, y)
        transposed = by_y.swapaxes(1, 2)
        # without the 1e-14 one singular row would raise an exception for all rows
        normal = transposed @ by_y + 1e-14 * np.eye(y.shape[1])
        step = -np.linalg.solve(normal, transposed @ residual[..., None])[..., 0]
        return np.asarray(step), np.abs(residual[:, : upper_ends.shape[2]]).max(axis=1)

    def _lever_mm(self, geometry: Geometry) -> float:
        """Return the lever that makes the platform's turn a length, for this robot's sizes."""
        forearm_mm = float(np.mean(geometry.arms["forearm"]))
        return self.platform.lever_mm(float(geometry.length[0, 0]), forearm_mm)

    # With the horizontal distances a_i of the upper ends from their middle, forearms of length L_i
    # that met below it would hang by √(L_i² - a_i²): the root of the mean square is the drop.
    def _guess_poses(
        self, geometry: Geometry, upper_ends: Array, turn_rad: float, lift_mm: float
    ) -> Array:
        """Return poses (N, t) of a platform that hangs under the middle of its upper ends."""
        middle = upper_ends.mean(axis=-1)
        outward2 = ((upper_ends[:2] - middle[:2, :, None]) ** 2).sum(axis=0)
        drop = np.sqrt(np.maximum(geometry.arms["forearm"] ** 2 - outward2, 0.0).mean(axis=-1))
        aside = self.platform.offsets(geometry.length, np.array([[turn_rad]])).mean(axis=-1)
        position = [middle[0] - aside[0], middle[1] - aside[1], middle[2] - drop + lift_mm]
        turns = [np.full_like(drop, turn_rad)] * (len(self.task) - 3)
        return np.stack([*position, *turns], axis=1)

    # Two assemblies meet at a singular pose, where det F_y vanishes, and have opposite signs of it
    # on either side: the sign distinguishes them. At home it is taken with the platform well below
    # its place, far from any singular pose; the forearms need not close there.
    def assembly_sign(self, geometry: Geometry) -> float:
        """Return the sign of the closures' determinant at home: joints 0, platform well below."""
        upper_ends = self.limb.upper_ends(geometry.arms, np.zeros((1, self.platform.arms)))
        pose = self._guess_poses(geometry, upper_ends, 0.0, -WELL_BELOW_MM)
        _, by_pose = self._differentiate_by_unknowns(geometry, upper_ends, pose)
        return float(np.sign(np.linalg.det(by_pose))[0])

    @np.errstate(invalid="ignore", over="ignore")
    def _is_wanted(self, geometry: Geometry, upper_ends: Array, poses: Array, sign: float) -> Mask:
        """Return which poses (N, t) hang below their upper ends, in the assembly mode of home."""
        _, by_pose = self._differentiate_by_unknowns(geometry, upper_ends, poses)
        is_below = poses[:, 2] < upper_ends[2].mean(axis=-1)
        is_mode_of_home = np.linalg.det(by_pose) * sign > 0.0
        turned_over = np.abs(poses[:, 3:]) >= self.platform.turn_limit_rad
        return np.asarray(is_below & is_mode_of_home & ~turned_over.any(axis=1))

    @override
    def is_mode_of_home(self, p: Array, joints: Array, poses: Array) -> Mask:
        geometry = self.geometry(p)
        upper_ends = self.limb.upper_ends(geometry.arms, self.true_joints(geometry, joints))
        return self._is_wanted(geometry, upper_ends, poses, self.assembly_sign(geometry))

    def _append_tilt(self, geometry: Geometry, upper_ends: Array, poses: Array) -> Array:
        """Return the unknowns (N, t + 3) of poses (N, t) of forearms with these upper ends."""
        y = np.pad(poses, ((0, 0), (0, 3)))
        if geometry.sag.any():
            y[:, 2] -= geometry.sag @ sag_basis(*y[:, :3].T)
        return self._solve_by_newton(geometry, upper_ends, y)[0] if geometry.tilts else y

    # --- inverse --------------------------------------------------------------------------------

    # A level plate's joints have a closed form, one arm at a time. Tilt, sag and yield change the
    # pose by little, so a fixed point around that form converges in a few rounds:
    #
    # 1. joints of the goal, at first the pose wanted, by the closed form;
    # 2. one Gauss-Newton step of the forward model at these joints: the pose reached;
    # 3. goal += pose wanted - pose reached, and again from 1.
    #
    # A row whose rounds do not settle has no solution: its joints would reach another pose.
    @override
    def inverse(self, p: Array, poses: Array, approach: Array | None = None) -> tuple[Array, Mask]:
        geometry, goal = self.geometry(p), poses.copy()
        joints, is_solved = self._inverse_of_level_plate(geometry, goal)
        bends = geometry.tilts or geometry.compliance.any() or geometry.sag.any()
        y = np.pad(poses, ((0, 0), (0, 3))) if geometry.tilts else poses.copy()
        rows, change = np.flatnonzero(is_solved & bends), np.zeros(len(poses))
        for _ in range(MOST_INVERSE_ROUNDS):
            if not len(rows):
                break
            true = joints[rows]
            if geometry.compliance.any():
                true = true + geometry.compliance * self._weight_loads(geometry, true, goal[rows])
            upper_ends = self.limb.upper_ends(geometry.arms, true)
            step, _ = self._gauss_newton_step(geometry, upper_ends, y[rows])
            y[rows] += step
            error = poses[rows] - self._poses_with_sag(geometry, y[rows])
            goal[rows] += error
            joints[rows], is_within_reach = self._inverse_of_level_plate(geometry, goal[rows])
            is_solved[rows] = is_within_reach & np.isfinite(error).all(axis=1)
            change[rows] = np.maximum(np.abs(error).max(axis=1), np.abs(step).max(axis=1))
            rows = rows[is_solved[rows] & (change[rows] > INVERSE_ERROR_MM)]
        is_solved &= change < 1e3 * INVERSE_ERROR_MM  # the last rounds may come close enough
        joints[~is_solved] = np.nan
        readings = transmission.encoder_readings(geometry.arms, joints, approach, self.phase_rate)
        return readings, is_solved

    def _inverse_of_level_plate(self, geometry: Geometry, poses: Array) -> tuple[Array, Mask]:
        return self.limb.inverse(geometry.arms, self.lower_ends(geometry, poses))

    # --- singularities and transmission -------------------------------------------------------

    # The smallest singular value σ of F_y bounds how far the plate can move with its joints held:
    # rods that give way by ε let it move by ε / σ. Rows of unit length and a turn counted at a
    # lever make σ a number that means the same for robots of every size.
    def singular_values(self, geometry: Geometry, upper_ends: Array, poses: Array) -> Array:
        """Return the smallest singular value of the closures' Jacobian, (N,), of a level plate."""
        _, by_pose = self._differentiate_by_unknowns(geometry, upper_ends, poses)
        by_pose[..., 3:] /= self._lever_mm(geometry)
        by_pose /= np.linalg.norm(by_pose, axis=-1, keepdims=True)
        return np.asarray(np.linalg.svd(by_pose, compute_uv=False)[:, -1])

    # Margins are those of a level plate at the joints' true angles: tilts of milliradians change
    # none of them noticeably.
    @override
    def margins(self, p: Array, joints: Array, poses: Array) -> Margins:
        geometry = self.geometry(p)
        true = self.true_joints(geometry, joints)
        upper_ends = self.limb.upper_ends(geometry.arms, true)
        forearms = self.lower_ends(geometry, poses) - upper_ends
        has_joints = np.isfinite(joints).all(axis=1)  # singular values of NaN would raise
        singular_value = np.full(len(poses), np.nan)
        singular_value[has_joints] = self.singular_values(
            geometry, upper_ends[:, has_joints], poses[has_joints]
        )
        return Margins(
            singular_value,
            self.limb.swing_rad(geometry.arms, forearms),
            self.limb.leverage(geometry.arms, true, forearms).min(axis=1),
            np.asarray(poses[:, 2] >= upper_ends[2].mean(axis=-1)),
        )

    @override
    def reach_mm(self, p: Array, joint: tuple[float, float], swing_rad: float) -> Array:
        return self.limb.reach_mm(self.geometry(p).arms, joint, swing_rad)

    # the controlled point of sliding bars is farther out by pinion times turn
    @override
    def reach_of_turns_mm(self, p: Array) -> float:
        return float(self.geometry(p).length[0, 0]) if self.platform.bars_along_x else 0.0

    @override
    def radius_mm(self, p: Array, turns: Array) -> float:
        lower_ends = self.platform.offsets(self.geometry(p).length, turns)
        return float(np.linalg.norm(lower_ends, axis=0).max())

    def true_joints(
        self, geometry: Geometry, joints: Array, approach: Array | None = None
    ) -> Array:
        """Return where joints are, less their offsets, at encoder readings (N, n)."""
        return transmission.true_joints(geometry.arms, joints, approach, self.phase_rate)


def _sum_closures(forearms: Array, forearm_mm: Array) -> Array:
    """Return (|g|² - L²) / 2L of forearms g (…, 3, N, n): about the rods' misfit |g| - L, mm."""
    return np.asarray((dot(forearms, forearms) - forearm_mm**2) / (2.0 * forearm_mm))


def _tilted_closures(geometry: Geometry, forearms: Array, bars: Array) -> Array:
    """Return sums and weighted differences (…, N, 2 n) of vectors g and e, (…, 3, N, n), in mm."""
    length = geometry.arms["forearm"]
    differences = dot(forearms, bars) / length - geometry.arms["parallelogram_skew"]
    sums = _sum_closures(forearms, length)
    return np.concatenate([sums, HALF_WIDTH_MM * differences], axis=-1)


def _unknowns_by_closures(by_y: Array) -> Array:
    """Return -F_y⁺, the derivatives (N, k, m) of unknowns by closures, from F_y (N, m, k)."""
    transposed = by_y.swapaxes(1, 2)
    return np.asarray(-np.linalg.solve(transposed @ by_y, transposed))


# Rods that differ by 0.2 mm and axes tilted by 2 mrad: first order leaves 6 µm rms, second 0.1 µm.
def rotation_less_identity(rotation: Array) -> Matrix:
    """Return R - 1 of rotation vectors (…, 3, N, 1) to second order.

    A rotation of 0.01 rad over 60 mm leaves 10 nm.
    """
    x, y, z = (rotation[..., k, :, :] for k in range(3))
    xx, yy, zz = 0.5 * x * x, 0.5 * y * y, 0.5 * z * z
    xy, xz, yz = 0.5 * x * y, 0.5 * x * z, 0.5 * y * z
    return ((-yy - zz, xy - z, xz + y), (xy + z, -xx - zz, yz - x), (xz - y, yz + x, -xx - yy))


def product(matrix: Matrix, of: Array) -> Array:
    """Return the products of a matrix with the vectors `of` (…, 3, N, n)."""
    x, y, z = (of[..., k, :, :] for k in range(3))
    return vectors(*(a * x + b * y + c * z for a, b, c in matrix))


def as_vectors(rows: Array) -> Array:
    """Return rows (…, N, 3) as vectors that all arms share, (…, 3, N, 1)."""
    return rows.swapaxes(-1, -2)[..., None]
