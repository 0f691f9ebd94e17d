"""Closed-chain mechanisms of equal limbs: |B_i(pose) - A_i(q_i)|² = L_i², one closure an arm.

A platform and a kind of arm make a mechanism: inverse, forward model, Jacobians and feasibility
follow from the closures and their derivatives.

For given joints more than one real assembly lies near the working region. The wanted one hangs
below its elbows, has |θ| < 90° where the plate is hinged, and the determinant of the closures'
Jacobian has the sign that it has at home. Newton alone ends on a wrong one, or far away, for about
one pose in a hundred, so every answer is checked for residual, turn, assembly mode and for
hanging, and what fails is started again from elsewhere.

How a plate tilts that imperfect parts hold is in `configuration.py` and `parasitic_rotation.py`.
"""

import copy
import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Self

import numpy as np

from campaigns.arrays import Array, Mask
from campaigns.mechanisms.arms import Arms
from campaigns.mechanisms.configuration import AZIMUTH, COORDINATES, Configuration, Limbs
from campaigns.mechanisms.mechanism import (
    Axis,
    Feasibility,
    KinematicSolution,
    Limits,
    Violation,
    outside,
)
from campaigns.mechanisms.parameters import PARALLELOGRAM_SKEW, ParameterSpace, Role
from campaigns.mechanisms.parasitic_rotation import (
    PlateGeometry,
    RodPairs,
    displacement,
    rotation_vectors,
)
from campaigns.mechanisms.platforms import Platform
from campaigns.mechanisms.transmission import Transmission

CHUNK = 4096
"""Rows worked on at a time, so that they stay in the processor's cache."""
ITERATIONS = 40
STEP_MM = 120.0
MISFIT_OF_STEP = 10.0
"""Largest misfit of a forearm before that step, as a multiple of the step."""
WELL_BELOW_MM = 100.0
"""Below the height at which a platform is guessed, for the assembly mode at home."""
LEAST_TURN_RAD = np.pi / 4
"""Turn that is searched each way, however narrow limits are drawn."""
TURNS_LOOKED_AT = 33
"""For the largest reach of a platform whose arms move as it turns."""
TILT_ROUNDS = 30
TILT_SETTLED_JOINT = 1e-13
"""Last step of joints and tilts in turn, rad or mm: each is some thousandth of the one before."""
FRAME_UNKNOWNS = 6
FEWEST_SHOTS = 3
"""Points that fix a frame, with none to spare."""
SKEW_SCALE_MM = 100.0
"""Typical distance of a plate joint from the measured point, which a tilted plate moves."""
HORIZONTAL = ("arm0.axis_tilt_deg", "arm1.axis_tilt_deg")
"""The axes of the first two cranks, which keep the frame from tilting, or the bars of the first two
carriages, which keep the platform from it."""
FIRST_CRANK = ("arm0.x_mm", "arm0.y_mm", "arm0.z_mm", "arm0.azimuth_deg", *HORIZONTAL)
"""The first crank places the frame, and its azimuth keeps it from turning about z."""


INITIAL_GUESSES = (
    (0.0, 0.0),
    (0.6, -40.0),
    (-0.6, -40.0),
    (0.0, -150.0),
    (0.9, 60.0),
    (-0.9, 60.0),
    (0.0, 150.0),
)
"""Turn in rad and height above the guessed one in mm, tried in turn."""


class ClosedChain:
    """Mechanism of a kind of arm and a platform."""

    def __init__(
        self,
        name: str,
        arms: type[Arms],
        platform: Platform,
        *,
        held_fields: tuple[str, ...],
        datum: tuple[str, ...] = FIRST_CRANK,
    ) -> None:
        self.name = name
        self.joints = tuple(Axis(f"q{number}", arms.joint) for number in range(platform.arms))
        self.task: tuple[Axis, ...] = platform.task
        self.parameters = ParameterSpace.of(
            platform.arms,
            arms.fields,
            platform.fields,
            (*arms.extensions, PARALLELOGRAM_SKEW),
            arms.transmission,
            dict.fromkeys(held_fields, Role.HELD) | dict.fromkeys(arms.leaning, Role.LEANING),
            datum,
        )
        self.azimuths = len(arms.fields) * np.arange(platform.arms) + AZIMUTH
        """Places of the arms' azimuths, (n,)."""
        self._arms = arms
        self.platform = self._own_platform = platform
        self.transmission = Transmission(arms.transmission)
        self.rate = 0.0
        """Of its drives' ripples, as `parameters.rate` has it; 0 where nobody knows."""
        self.plate = PlateGeometry.typical(
            np.linspace(0.0, 2.0 * np.pi, platform.arms, endpoint=False),
            follows_arms=arms.azimuth_is_outward,
        )
        self._of_arms = platform.arms * len(arms.fields)
        self._has_turn = len(platform.task) > COORDINATES

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, ClosedChain):
            return NotImplemented
        own, others = (
            (each.name, each.plate, each.platform.at_point, each.transmission)
            for each in (self, other)
        )
        return own == others

    def __hash__(self) -> int:
        return hash((self.name, self.plate, self.transmission))

    def inverse(self, p: Array, poses: Array, approach: Array | None = None) -> KinematicSolution:
        """Joints (N, n) of poses (N, t) as the encoders read them, reached by `approach`."""
        values, platform, extensions = self._split(p[:, None])
        targets_mm = self.platform.joints_mm(platform, poses)
        tilts, pairs = extensions[:, :-1], self._rod_pairs(values, extensions)
        joints, found = self._arms.inverse(values[..., 0], tilts[..., 0], targets_mm)
        if not pairs.are_level and found.any():
            some = targets_mm[found]
            seen_mm = self.plate.seen_mm((some - poses[found][:, None, :COORDINATES]).T)
            level, gibbs = joints[found], None
            for _ in range(TILT_ROUNDS):
                elbows_mm = self._arms.at(values, tilts, level).elbows_mm
                gibbs = pairs.tilt(some.T - elbows_mm, seen_mm, gibbs)
                before = level
                level, held = self._arms.inverse(
                    values[..., 0], tilts[..., 0], some + displacement(gibbs, seen_mm).T
                )
                if not np.abs(level - before)[held].max(initial=0.0) > TILT_SETTLED_JOINT:
                    break
            joints[found], found[found] = level, held
        return KinematicSolution.where(found, self.encoder_readings(p, joints, approach))

    def forward(
        self, p: Array, joints: Array, near: Array | None = None, approach: Array | None = None
    ) -> KinematicSolution:
        """Poses (N, t) of joints (N, n); `near` (N, t) are poses near them, as those commanded.

        `approach` (N, n) says by its sign to which side each joint moved last.
        """
        joints = np.atleast_2d(np.asarray(joints, dtype=np.float64))
        starts = None if near is None else np.atleast_2d(near)
        poses = np.empty((len(joints), len(self.task)))
        found = np.empty(len(joints), dtype=bool)
        for first in range(0, len(joints), CHUNK):
            rows = slice(first, first + CHUNK)
            some_near = None if starts is None else starts[rows]
            sides = None if approach is None else approach[rows]
            solved = self.configuration(p, joints[rows], sides).assemble(some_near)
            poses[rows], found[rows] = solved.values, solved.found
        return KinematicSolution(poses, found)

    def jacobian(
        self, p: Array, joints: Array, poses: Array, approach: Array | None = None
    ) -> Array:
        """d(pose)/dp (N, t, P) at fixed joints, by the implicit function theorem on the closures.

        Raises `numpy.linalg.LinAlgError` at a singular pose.
        """
        geometry = self.configuration(p, joints, approach).jacobian(poses)
        by_offsets = geometry[:, :, self.parameters.offsets]
        terms = self.transmission.terms(joints, approach)
        more = self.transmission.columns(by_offsets, terms)
        return np.concatenate([geometry, more], axis=2)

    def true_joints(self, p: Array, joints: Array, approach: Array | None = None) -> Array:
        """Joints of the arms (N, n), but for their offsets, at encoder readings (N, n)."""
        return self.transmission.true_joints(self._lost(p), joints, approach)

    def encoder_readings(self, p: Array, joints: Array, approach: Array | None = None) -> Array:
        """Encoder readings (N, n) at which arms are at these joints (N, n), offsets aside."""
        return self.transmission.encoder_readings(self._lost(p), joints, approach)

    def joint_slopes(self, p: Array, joints: Array) -> Array:
        """Change of the arms' joints over that of encoder readings (N, n), (N, n)."""
        return self.transmission.slopes(self._lost(p), joints)

    def steepest_error(self, p: Array) -> float:
        """Bound of the change of any joint's error over its motion."""
        return self.transmission.steepest(self._lost(p))

    def plate_tilt(self, p: Array, joints: Array, poses: Array) -> Array:
        """Rotation vectors of the plate in the base frame, (N, 3) rad; zero of perfect parts."""
        return rotation_vectors(self.configuration(p, joints).tilt(poses)).T

    def typical_plate(self, p: Array) -> PlateGeometry:
        """Plate of a robot whose file has none."""
        values, _, _ = self._split(p)
        outward_rad = self._arms.outward_rad(values)
        return PlateGeometry.typical(outward_rad, follows_arms=self._arms.azimuth_is_outward)

    def with_plate(self, plate: PlateGeometry) -> Self:
        """Mechanism with another plate."""
        chain = copy.copy(self)
        chain.plate = plate
        return chain

    def seen_from(self, half: int | None) -> Self:
        """Mechanism whose measured point is on part 1 or 2 of its platform; None: as controlled.

        Parameters are the same: where on a part a point is, a frame takes up. Raises `ValueError`
        for a platform of one part.
        """
        own = self._own_platform
        seen = own if half is None else own.seen_from(half)
        if seen.at_point == self.platform.at_point:
            return self
        chain = copy.copy(self)
        chain.platform = seen
        if half is None:  # where the reflector is on another part says nothing of this one
            chain.plate = replace(self.plate, reflector_mm=(0.0, 0.0, 0.0))
        return chain

    def with_ripples(self, rate: float) -> Self:
        """Mechanism whose drives' ripples come so often, as `parameters.rate` has it."""
        chain = copy.copy(self)
        chain.rate, phase = rate, self.parameters.phase_rate(rate)
        chain.transmission = replace(self.transmission, ripple_rate=phase)
        return chain

    def configuration(
        self, p: Array, joints: Array, approach: Array | None = None
    ) -> Configuration:
        """Arms at encoder readings (N, n), for whoever needs both poses and Jacobian."""
        values, platform, extensions = self._split(p[:, None])
        true_joints = self.true_joints(p, joints, approach)
        arms = self._arms.at(values, extensions[:, :-1], true_joints)
        pairs = self._rod_pairs(values, extensions)
        return Configuration(self, platform, arms, pairs, self.assembly_sign(p))

    def assembly_sign(self, p: Array) -> Array:
        """Sign of the closures' determinant at home, (1,).

        That is at joints 0, the platform well below the elbows.
        """
        values, platform, extensions = self._split(p[:, None])
        home = np.zeros((1, len(self.joints)))
        arms = self._arms.at(values, extensions[:, :-1], home)
        limbs = Limbs(arms.elbows_mm, arms.forearm_mm, platform, np.ones(len(home)))
        _, determinant, _ = self.newton_step(limbs, self._guess(limbs, 0.0, -WELL_BELOW_MM))
        return np.sign(determinant)

    def feasibility(self, p: Array, limits: Limits, poses: Array) -> Feasibility:
        """Margins of poses (N, t) by reach, limits, forearm swing and distance from singularity."""
        solution = self.inverse(p, poses)
        joints, found = solution.values, solution.found
        judged = self._margins(p, limits, joints, poses, found)
        beyond = outside(joints, limits.joint).any(axis=1) * int(Violation.JOINT_LIMIT)
        violations = judged.violations | ~found * int(Violation.OUT_OF_REACH) | beyond
        return replace(judged, violations=violations.astype(np.uint8))

    def path_feasibility(
        self, p: Array, limits: Limits, joints: Array, poses: Array
    ) -> Feasibility:
        """Feasibility of poses (N, t) that are passed at known joints, whose limits don't count."""
        return self._margins(p, limits, joints, poses, np.ones(len(poses), dtype=bool))

    def search_extent(self, p: Array, limits: Limits, centre: Array) -> Array:
        """Half size (t,) of a box about a pose that holds all that arms reach, and the turn."""
        values, platform, extensions = self._split(p)
        half = np.empty(len(self.task))
        half[COORDINATES:] = LEAST_TURN_RAD
        for place, interval in enumerate(limits.task[COORDINATES:], COORDINATES):
            if interval is not None:
                half[place] = max(0.5 * (interval[1] - interval[0]), LEAST_TURN_RAD)
        reach_mm = self._arms.reach_mm(values, extensions, limits, centre[:COORDINATES])
        slides = self.platform.points_along_x
        aside_mm = self.platform.turn_scale(platform, values[:, -1]).lever_mm if slides else 0.0
        half[:COORDINATES] = reach_mm + aside_mm * half[COORDINATES:].sum()
        for place, interval in enumerate(limits.task[:COORDINATES]):
            if interval is not None:
                half[place] = 0.5 * (interval[1] - interval[0])
        return half

    def platform_radius_mm(self, p: Array, limits: Limits) -> float:
        """Farthest lower end of a forearm from the measured point; 0 of a contracted platform."""
        _, platform, _ = self._split(p)
        poses = np.zeros((TURNS_LOOKED_AT, len(self.task)))
        for place, interval in enumerate(limits.task):
            if interval is not None and self.task[place].is_revolute:
                poses[:, place] = np.linspace(*interval, len(poses))
        ends_mm = self.platform.joints_mm(platform, poses)
        return float(np.linalg.norm(ends_mm, axis=-1).max())

    def minimum_shots(self, names: Sequence[str]) -> int:
        """Fewest shots that tell the named parameters and the frame.

        A shot has three coordinates. Where two arms end in the measured point two of them are about
        these arms and the frame alone, the third about the rest, for the turn is not measured.
        """
        near = self.platform.at_point
        if not near:
            return max(FEWEST_SHOTS, math.ceil((len(names) + FRAME_UNKNOWNS) / COORDINATES))
        every, free = self.parameters, [self.parameters[name] for name in names]
        held = (every[name] for name in every.datum if name not in names)
        fixed = {each.field.name for each in held if each.arm == 0}
        own = sum(each.arm in near for each in free)
        if 0 not in near:  # the rest alone tells how these arms stand to the datum
            own -= sum(each.arm == near[0] and each.field.name in fixed for each in free)
        by_rest = int(self.platform.points_along_x and not self._arms.shows_turn)
        by_two = math.ceil((own + FRAME_UNKNOWNS - by_rest) / len(near))
        return max(FEWEST_SHOTS, by_two, len(names) - own + by_rest)

    def sensitivity_scale_mm(self, p: Array) -> Array:
        """Lengths that turn errors of `parameters.of_robot` into errors of place, (M,)."""
        values, platform, extensions = self._split(p)
        scale, fields = self._arms.sensitivity_scale_mm(values), values.shape[1]
        last = fields + extensions.shape[1] - 1
        scale = np.insert(scale, last, SKEW_SCALE_MM, axis=1)
        own, beyond = scale[:, :fields].ravel(), scale[:, fields:].T.ravel()
        return np.concatenate([own, np.ones(len(platform)), beyond])

    def _split(self, p: Array) -> tuple[Array, Array, Array]:
        """Fields of the arms (n, k, …), of the platform (f, …), extensions of the arms (n, e, …).

        Of parameters (G, …).
        """
        space, end = self.parameters, self._of_arms
        named = len(space.names)
        beyond = p[named : len(space.geometry)]
        rest = p.shape[1:]
        extensions = beyond.reshape(len(space.extension_fields), space.arms, *rest)
        values = p[:end].reshape(space.arms, len(space.arm_fields), *rest)
        return values, p[end:named], extensions.swapaxes(0, 1)

    def _lost(self, p: Array) -> Array:
        """Transmission (f, n) in a vector, which may hold the geometry alone."""
        space, fields = self.parameters, len(self.transmission.fields)
        own = p[len(space.geometry) : len(space.of_robot)]
        return own.reshape(fields, -1) if len(own) else np.zeros((fields, space.arms))

    def _rod_pairs(self, values: Array, extensions: Array) -> RodPairs:
        azimuths = values[:, AZIMUTH]
        if self.plate.outward_rad is not None:
            azimuths = np.array(self.plate.outward_rad)[:, None]
        return RodPairs.of(azimuths, extensions[:, -2], extensions[:, -1], values[:, -1])

    def _margins(
        self, p: Array, limits: Limits, joints: Array, poses: Array, found: Mask
    ) -> Feasibility:
        configuration = self.configuration(p, joints)
        forearms = configuration.forearms_mm(poses)
        swing = configuration.arms.swing_rad(forearms)
        elbow = configuration.arms.leverage(forearms).min(axis=1)
        singular = np.full(len(poses), np.nan)
        forearm_mm = configuration.arms.forearm_mm
        lever_mm = self.platform.turn_scale(configuration.platform, forearm_mm).lever_mm
        by_pose = configuration.by_pose(poses, forearms)[found]
        singular[found] = _smallest_singular_value(by_pose, lever_mm)
        too_near = (singular < limits.singularity_margin) | (elbow < limits.elbow_margin)
        beyond = np.zeros(len(poses), dtype=bool)
        for column, interval in zip(poses.T, limits.task, strict=True):
            if interval is not None:
                beyond |= outside(column, interval)
        above = poses[:, 2] >= configuration.arms.elbows_mm[2].mean(axis=0)
        violations = (
            beyond * int(Violation.TASK_LIMIT)
            | above * int(Violation.ABOVE_ELBOWS)
            | (np.abs(swing) > limits.forearm_swing_rad).any(axis=1) * int(Violation.SWING_LIMIT)
            | too_near * int(Violation.SINGULAR)
        )
        return Feasibility(
            poses,
            joints,
            swing,
            singular,
            elbow,
            violations.astype(np.uint8),
            limits,
            self.joints,
            self.task,
            self._arms.words,
        )

    def newton_step(self, limbs: Limbs, poses: Array) -> tuple[Array, Array, Array]:
        """Step (t, N), the determinant (N,) and by how much forearms are too long, (n, N).

        Poses (t, N) are by component.
        """
        offsets_mm = self.platform.offsets_mm(limbs.platform, poses.T)
        forearms = poses[:COORDINATES, None] + offsets_mm - limbs.elbows_mm
        f = 0.5 * (np.einsum("kin,kin->in", forearms, forearms) - limbs.forearm_mm**2)
        matrix = np.empty((len(f), len(poses), poses.shape[1]))
        matrix[:, :COORDINATES] = forearms.swapaxes(0, 1)
        if self._has_turn:
            by_turn = self.platform.joints_by_turn(limbs.platform, poses.T)
            matrix[:, COORDINATES] = (forearms * by_turn).sum(axis=0)
        step, determinant = solve_rows(matrix, -f)
        return step, determinant, f / limbs.forearm_mm

    def assemble(self, limbs: Limbs, start: Array | None, converged_mm: float) -> KinematicSolution:
        """Poses of arms that are at their joints; a step below `converged_mm` is the last one.

        That leaves an error of about its square over the forearm's length.
        """
        if start is None:
            poses, good = self._newton(limbs, self._guess(limbs, *INITIAL_GUESSES[0]), converged_mm)
        else:
            poses, good = self._newton(limbs, np.ascontiguousarray(start.T), converged_mm)
        pending = ~good
        for theta_rad, lift_mm in INITIAL_GUESSES if start is not None else INITIAL_GUESSES[1:]:
            if not pending.any():
                break
            some = limbs.rows(pending)
            found, good = self._newton(some, self._guess(some, theta_rad, lift_mm), converged_mm)
            places = np.flatnonzero(pending)[good]
            poses[:, places] = found[:, good]
            pending[places] = False
        return KinematicSolution.where(~pending, poses.T)

    def _guess(self, limbs: Limbs, theta_rad: float, lift_mm: float) -> Array:
        """Platform that hangs under the middle of its elbows, (t, N)."""
        middle = limbs.elbows_mm.mean(axis=1)
        outward = limbs.elbows_mm[:2] - middle[:2, None]
        drop2_mm2 = limbs.forearm_mm**2 - (outward * outward).sum(axis=0)
        drop_mm = np.sqrt(np.maximum(drop2_mm2, 0.0).mean(axis=0))
        turned = np.zeros((len(drop_mm), len(self.task)))
        turned[:, COORDINATES:] = theta_rad
        aside = self.platform.offsets_mm(limbs.platform, turned).mean(axis=1)
        rows = [middle[0] - aside[0], middle[1] - aside[1], middle[2] - drop_mm + lift_mm]
        turns = [np.full_like(drop_mm, theta_rad)] if self._has_turn else []
        return np.stack([*rows, *turns])

    def is_wanted(self, limbs: Limbs, poses: Array, determinant: Array) -> Mask:
        """Whether assembled poses (t, N) hang below their elbows, in the mode of home, (N,)."""
        wanted = poses[2] < limbs.elbows_mm[2].mean(axis=0)
        wanted &= determinant * limbs.assembly_sign > 0.0
        if self._has_turn:
            limit_rad = self.platform.turn_scale(limbs.platform, limbs.forearm_mm).limit_rad
            wanted &= np.abs(poses[COORDINATES]) < limit_rad
        return np.asarray(wanted)

    @np.errstate(divide="ignore", invalid="ignore", over="ignore")
    def _newton(self, limbs: Limbs, start: Array, converged_mm: float) -> tuple[Array, Mask]:
        """Poses (t, N) and which of them passed the checks; singular rows are dropped."""
        poses = start.copy()
        good = np.zeros(poses.shape[1], dtype=bool)
        active = np.arange(poses.shape[1])
        some, current = limbs, poses.copy()
        turn = self.platform.turn_scale(limbs.platform, limbs.forearm_mm)
        for _ in range(ITERATIONS):
            step, determinant, misfit_mm = self.newton_step(some, current)
            move_mm = np.abs(step[:COORDINATES]).max(axis=0)
            turn_rad = np.abs(step[COORDINATES]) if self._has_turn else np.zeros_like(move_mm)
            current += step / np.maximum(
                np.maximum(move_mm / STEP_MM, turn_rad / turn.step_rad), 1.0
            )
            size_mm = move_mm + turn.lever_mm * turn_rad
            on_its_way = size_mm >= converged_mm
            if not on_its_way.all():
                closed = (np.abs(misfit_mm) < MISFIT_OF_STEP * converged_mm).all(axis=0)
                wanted = self.is_wanted(some, current, determinant)
                poses[:, active] = current
                good[active] = (size_mm < converged_mm) & closed & wanted
                keep = on_its_way & np.isfinite(size_mm)
                if not keep.any():
                    break
                active, current, some = active[keep], current[:, keep], some.rows(keep)
                turn = self.platform.turn_scale(some.platform, some.forearm_mm)
        return poses, good


def solve_rows(matrix: Array, right: Array) -> tuple[Array, Array]:
    """Solutions (t, N) and determinants (N,) of square systems (t, t, N) with right sides (t, N).

    Gauss-Jordan with row pivots on all systems at once: for few unknowns several times faster than
    a batched call.
    """
    system = np.concatenate([matrix, right[:, None]], axis=1)
    size, columns = len(system), np.arange(system.shape[2])
    determinant = np.ones(system.shape[2])
    for place in range(size):
        pivot = place + np.argmax(np.abs(system[place:, place]), axis=0)
        swapped = pivot != place
        if swapped.any():
            rows, where = pivot[swapped], columns[swapped]
            upper = system[place][:, where].copy()
            system[place][:, where] = system[rows, :, where].T
            system[rows, :, where] = upper.T
            determinant[where] = -determinant[where]
        head = system[place, place]
        determinant = determinant * head
        system[place, place:] = system[place, place:] / head
        for row in range(size):
            if row != place:
                system[row, place:] = (
                    system[row, place:] - system[row, place] * system[place, place:]
                )
    return system[:, size], determinant


def _smallest_singular_value(jacobian: Array, lever_mm: Array) -> Array:
    jacobian[..., COORDINATES:] /= lever_mm
    jacobian /= np.linalg.norm(jacobian, axis=-1, keepdims=True)
    return np.asarray(np.linalg.svd(jacobian, compute_uv=False)[..., -1])
