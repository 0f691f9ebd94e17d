"""Closed chains at given joints: assembled and differentiated, the plate as it tilts.

Unequal rods and tilted axes tilt the plate by milliradians (`parasitic_rotation.py`), and the tilt
moves the plate's joints. Seen from the measured point that is the level chain with its elbows moved
the other way: a few rounds of tilt and pose agree to rounding.
"""

from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, TypeAlias

import numpy as np

from campaigns.arrays import Array, Mask
from campaigns.mechanisms.arms import Arms
from campaigns.mechanisms.mechanism import KinematicSolution
from campaigns.mechanisms.parasitic_rotation import (
    TYPICAL_JOINT_MM,
    RodPairs,
    TiltedForearms,
    cross,
    displacement,
    inverse_of_four,
    inverse_of_three,
    turned_further,
)

if TYPE_CHECKING:
    from campaigns.mechanisms.closed_chain import ClosedChain

COORDINATES = 3
AZIMUTH, FOREARM = 3, 6
"""Places among the fields of an arm of any kind."""
CONVERGED_MM = 1e-5
"""A Newton step shorter than this leaves an error of its square over the forearm's length."""
TILT_ROUNDS = 30
FOLLOWED_ROUNDS = 10
"""From poses and tilts near by; where these don't settle, a level plate is assembled first."""
TILT_SETTLED_PER_MM = 0.001
"""What the last step of poses and tilts may leave, over the square of that of poses alone: as that
leaves its square over the forearm's length."""
TILT_CLOSED_MM = 1e-4
NEARLY_MM = 1e-1
"""Step at which a level plate is near enough to be tilted."""
CONTRACTION = 0.2
"""Part of a step that the next one with the same derivatives may have at most."""
FIRST_CONTRACTION = 1e-3
"""That of the first step, where it is so short that the poses expected were near."""
FIRST_CONTRACTION_PER_MM = 1.0
"""That of a still shorter one, over its length: what Newton's steps leave goes by their square."""
SETTLED_SHARE = 1e-6
"""Of that step: what is left of it leads no fit astray, whose next steps are far shorter."""


Elimination: TypeAlias = tuple[Array, Array, Array, Array]
"""As `_elimination` has them -(F_z + C H_z)⁻¹ (t, n, N), C (n, 3, N), H_s⁻¹ (3, 3, N) and H_z
(3, t, N)."""
TiltElimination: TypeAlias = tuple[Array, Elimination]
"""Plate's tilt (3, N) where a Jacobian was asked for, and its elimination there."""


@dataclass(frozen=True, slots=True, eq=False)
class Limbs:
    """Elbows by component (3, n, N), forearm lengths (n, 1), platform fields (f, 1)."""

    elbows_mm: Array
    forearm_mm: Array
    platform: Array
    assembly_sign: Array
    """Sign of the determinant of the closures' Jacobian at home, (1,): the assembly mode."""

    def rows(self, chosen: Mask) -> "Limbs":
        """Limbs of some of the rows."""
        return replace(self, elbows_mm=self.elbows_mm[:, :, chosen])


@dataclass(frozen=True, slots=True, eq=False)
class Configuration:
    """Arms of a closed chain at joints (N, n), and the platform's fields, (f, 1)."""

    chain: "ClosedChain"
    platform: Array
    arms: Arms
    pairs: RodPairs
    assembly_sign: Array
    """(1,)"""
    _assembled: list[tuple[Array, Array]] = field(default_factory=list)
    """Poses last assembled, and the plate's tilt there."""
    _eliminated: list[TiltElimination] = field(default_factory=list)

    @property
    def tilt_elimination(self) -> TiltElimination | None:
        """That of the last Jacobian, for `assemble` of a robot near; None where none was needed."""
        return self._eliminated[0] if self._eliminated else None

    def assemble(
        self,
        near: Array | None = None,
        converged_mm: float = CONVERGED_MM,
        about: TiltElimination | None = None,
    ) -> KinematicSolution:
        """Poses (N, t) of the joints, from poses near them.

        A step below `converged_mm` is the last one. `about` is of the robot whose Jacobian said
        where they are near.
        """
        limbs = self._limbs()
        if self.pairs.are_level:
            return self.chain.assemble(limbs, near, converged_mm)
        settled_mm = TILT_SETTLED_PER_MM * converged_mm**2
        gibbs = np.zeros((COORDINATES, limbs.elbows_mm.shape[2]))
        if near is None:
            level = self.chain.assemble(limbs, None, NEARLY_MM)
            return self._tilted(level, gibbs, settled_mm)
        with suppress(np.linalg.LinAlgError):
            followed = self._followed(limbs, near, converged_mm, about)
            if followed.found.all():
                return followed
        moved, gibbs = self._moved(limbs, near, gibbs)
        level = self.chain.assemble(moved, near, NEARLY_MM)
        return self._tilted(level, gibbs, settled_mm)

    def tilt(self, poses: Array) -> Array:
        """Gibbs vectors (3, N) of the plate at poses (N, t)."""
        if self.pairs.are_level:
            return np.zeros((COORDINATES, len(poses)))
        if self._assembled and self._assembled[0][0] is poses:
            return self._assembled[0][1]
        return self.pairs.tilt(*self._seen(self.arms.elbows_mm, poses))

    def forearms_mm(self, poses: Array) -> Array:
        """A_iB_i at poses (N, t) of a level plate, (3, n, N)."""
        offsets_mm = self.chain.platform.offsets_mm(self.platform, poses)
        return np.asarray(_at(poses) + offsets_mm - self.arms.elbows_mm)

    def by_pose(self, poses: Array, forearms_mm: Array) -> Array:
        """∂F/∂pose, (N, n, t), from forearms (3, n, N) to a level plate."""
        chain = self.chain
        jacobian = np.empty((forearms_mm.shape[1], len(chain.task), len(poses)))
        jacobian[:, :COORDINATES] = forearms_mm.swapaxes(0, 1)
        if len(chain.task) > COORDINATES:
            by_turn = chain.platform.joints_by_turn(self.platform, poses)
            jacobian[:, COORDINATES] = (forearms_mm * by_turn).sum(axis=0)
        jacobian *= 2.0
        return jacobian.transpose(2, 0, 1)

    def jacobian(self, poses: Array, *, extended: bool = True, azimuths: bool = True) -> Array:
        """d(pose)/dp (N, t, G) at fixed joints, of the poses that they assemble to.

        Columns that are not asked for say nothing: those of extensions are 0 of a level plate,
        those of azimuths may be anything of a tilted one.
        """
        if not self.pairs.are_level:
            return self._tilting_jacobian(poses, self.tilt(poses), azimuths=azimuths)
        forearms, by_closure, own, by_platform = self._level(poses)
        by_all, beyond = self._by_all(by_closure, own, by_platform)
        if extended:
            by_misfit = self._by_misfit(poses, forearms, by_closure)
            beyond[:, -2] -= by_misfit * (forearms[2] / self.arms.forearm_mm)
            beyond[:, -1] = -by_misfit
        else:
            beyond[:] = 0.0
        return by_all.transpose(2, 0, 1)

    def _level(self, poses: Array) -> tuple[Array, Array, Array, Array]:
        """Forearms of a level plate (3, n, N), and its d(pose)/dF (t, n, N).

        And ∂F by each arm's own fields (n, k, N), and by the platform's (f, n, N).
        """
        forearms = self.forearms_mm(poses)
        by_closure = _inverse(self.by_pose(poses, forearms))
        own, by_platform = self.arms.by_fields(forearms), self._by_platform(poses, forearms)
        return forearms, by_closure, own, by_platform

    def _by_misfit(self, poses: Array, forearms_mm: Array, by_closure: Array) -> Array:
        """d(pose)/d(misfit of the rods' differences) of a plate that is still level, (t, n, N).

        As of the tilting one, where neither bars nor misfits add anything.
        """
        pairs, offsets_mm = self.pairs, forearms_mm + (self.arms.elbows_mm - _at(poses))
        seen = self.chain.plate.seen_mm(offsets_mm)
        weights = pairs.crossed(forearms_mm)
        inverse = inverse_of_three(np.einsum("kin,lin->kln", weights, weights))
        eliminated = _product(2.0 * cross(forearms_mm, seen).swapaxes(0, 1), inverse)
        elimination = (
            by_closure,
            eliminated,
            inverse,
            np.zeros((COORDINATES, *by_closure.shape[::2])),
        )
        self._eliminated[:] = [(np.zeros((COORDINATES, len(poses))), elimination)]
        return np.asarray(np.einsum("tkn,kin->tin", _product(by_closure, eliminated), weights))

    def _tilting_jacobian(self, poses: Array, gibbs: Array, *, azimuths: bool) -> Array:
        """Jacobian without the plate's tilt, from what closures and normal equations do to it."""
        platform = self.chain.platform
        state = self.pairs.state(*self._seen(self.arms.elbows_mm, poses), gibbs)
        elimination = self._elimination(state, poses)
        self._eliminated[:] = [(gibbs, elimination)]
        by_closure, eliminated, *_ = elimination
        by_normal = _product(by_closure, eliminated)
        by_misfit, by_forearm = state.sensitivities(by_closure, by_normal)
        by_all, by_arms, by_plate, beyond = self._columns(by_closure)
        own, fields = self.arms.by_fields(by_forearm, azimuths=azimuths), by_arms.shape[2]
        by_arms[:], beyond[:, :-1] = own[:, :, :fields], own[:, :, fields:].swapaxes(1, 2)
        for place, moved in enumerate(platform.joints_by_fields(self.platform, poses)):
            by_plate[:, place] = 2.0 * np.einsum("ktin,kin->tn", by_forearm, state.rotated(moved))
        # what does not go through the forearms: lengths, and the directions of bars
        if azimuths and self.chain.plate.outward_rad is None:
            by_arms[:, :, AZIMUTH] += state.by_azimuths(by_misfit, by_normal)
        by_length, by_axis_tilt, beyond[:, -1] = state.by_own_parameters(by_misfit)
        by_arms[:, :, FOREARM] = by_length - 2.0 * by_closure * self.pairs.forearm_mm
        beyond[:, -2] += by_axis_tilt
        return by_all.transpose(2, 0, 1)

    def _elimination(self, state: TiltedForearms, poses: Array) -> Elimination:
        """Of the tilt: closures F and normal equations H vanish with it.

        dF = F_z dz + F_s ds + F_p dp and dH alike give ds, and with C = -F_s H_s⁻¹
        dz = -(F_z + C H_z)⁻¹ (F_p + C H_p).
        """
        tasks, by_turn = len(self.chain.task), None
        if tasks > COORDINATES:
            platform = self.chain.platform
            by_turn = state.rotated(platform.joints_by_turn(self.platform, poses))
        closures, normal = state.by_pose_and_turn(by_turn)
        inverse = inverse_of_three(normal[:, tasks:])
        eliminated = -_product(closures[tasks:].swapaxes(0, 1), inverse)
        by_pose = closures[:tasks].swapaxes(0, 1) + _product(eliminated, normal[:, :tasks])
        return _inverse(by_pose.transpose(2, 0, 1)), eliminated, inverse, normal[:, :tasks]

    def _by_platform(self, poses: Array, forearms_mm: Array) -> Array:
        """∂F by the platform's fields, (f, n, N), from forearms (3, n, N) to a level plate."""
        moved = self.chain.platform.joints_by_fields(self.platform, poses)
        return np.asarray(2.0 * (forearms_mm * moved).sum(axis=1))

    def _by_all(self, by_closure: Array, own: Array, by_platform: Array) -> tuple[Array, Array]:
        """d(pose)/dp (t, G, N) of parameters that enter their own arm's closure alone.

        And a view of its columns of extensions, (t, e, n, N).
        """
        by_all, by_arms, by_plate, beyond = self._columns(by_closure)
        fields = by_arms.shape[2]
        np.multiply(by_closure[:, :, None], own[:, :fields], out=by_arms)
        for place, each in enumerate(by_platform):
            by_plate[:, place] = (by_closure * each).sum(axis=1)
        tilts = own[:, fields:].swapaxes(0, 1)
        np.multiply(by_closure[:, None], tilts, out=beyond[:, : len(tilts)])
        return by_all, beyond

    def _columns(self, by_closure: Array) -> tuple[Array, Array, Array, Array]:
        """Zeros d(pose)/dp (t, G, N), and its columns of arms, platform and extensions as views."""
        space, (tasks, arms, rows) = self.chain.parameters, by_closure.shape
        by_all = np.zeros((tasks, len(space.geometry), rows))
        end, named = arms * len(space.arm_fields), len(space.names)
        by_arms = by_all[:, :end].reshape(tasks, arms, -1, rows)
        return (
            by_all,
            by_arms,
            by_all[:, end:named],
            by_all[:, named:].reshape(tasks, -1, arms, rows),
        )

    def _limbs(self) -> Limbs:
        return Limbs(self.arms.elbows_mm, self.arms.forearm_mm, self.platform, self.assembly_sign)

    def _seen(self, elbows_mm: Array, poses: Array) -> tuple[Array, Array]:
        """Forearms to plate joints, and these seen from the measured point, (3, n, N) each."""
        offsets_mm = self.chain.platform.offsets_mm(self.platform, poses)
        return _at(poses) + offsets_mm - elbows_mm, self.chain.plate.seen_mm(offsets_mm)

    def _moved(self, limbs: Limbs, poses: Array, gibbs: Array) -> tuple[Limbs, Array]:
        """Limbs that hold a level plate where the tilted one is, and its Gibbs vectors (3, N).

        These are some thousand times nearer to the plate's than those given.
        """
        forearms, seen = self._seen(limbs.elbows_mm, poses)
        gibbs, _ = self.pairs.approached(forearms, seen, gibbs)
        return replace(limbs, elbows_mm=limbs.elbows_mm - displacement(gibbs, seen)), gibbs

    @np.errstate(divide="ignore", invalid="ignore", over="ignore")
    def _followed(
        self, limbs: Limbs, near: Array, converged_mm: float, about: TiltElimination | None
    ) -> KinematicSolution:
        """Poses (N, t) of a tilted plate from poses near them, as `assemble`; all or none.

        By Newton's steps of poses and tilts. Derivatives are those of the robot about which they
        are known, or the last ones, while steps shrink fast: then no pose on their way is singular,
        and the assembly mode stays. Raises `LinAlgError` at a singular pose.
        """
        settled_mm = TILT_SETTLED_PER_MM * converged_mm**2
        gibbs = np.zeros((COORDINATES, len(near)))
        if about is not None:
            gibbs, elimination = about
        poses, determinant = np.ascontiguousarray(near.T), limbs.assembly_sign
        last_mm, is_known, is_settled = 0.0, about is not None, False
        for rounds in range(FOLLOWED_ROUNDS):
            forearms, seen = self._seen(limbs.elbows_mm, poses.T)
            state = self.pairs.state(forearms, seen, gibbs)
            if not is_known:
                elimination = self._elimination(state, poses.T)
                moved = replace(limbs, elbows_mm=limbs.elbows_mm + forearms - state.forearms_mm)
                _, determinant, _ = self.chain.newton_step(moved, poses)
            by_closure, eliminated, by_turn, by_pose = elimination
            normal = state.normal_equations()
            step = _applied(by_closure, state.closures() + _applied(eliminated, normal))
            turn = -_applied(by_turn, normal + _applied(by_pose, step))
            poses, gibbs = poses + step, turned_further(gibbs, turn)
            moved_mm = np.concatenate([step[:COORDINATES], TYPICAL_JOINT_MM * turn])
            size_mm = float(np.abs(moved_mm).max())
            if rounds:
                contraction = size_mm / last_mm
            else:
                contraction = min(FIRST_CONTRACTION, FIRST_CONTRACTION_PER_MM * size_mm)
                if about is not None:
                    settled_mm = max(settled_mm, SETTLED_SHARE * size_mm)
            is_settled = size_mm * contraction <= settled_mm
            if is_settled or not np.isfinite(size_mm):
                break
            is_known, last_mm = not is_known or contraction < CONTRACTION, size_mm
        values = np.ascontiguousarray(poses.T)
        self._assembled[:] = [(values, gibbs)]
        wanted = self.chain.is_wanted(limbs, poses, determinant)
        return KinematicSolution.where(wanted & is_settled, values)

    @np.errstate(divide="ignore", invalid="ignore", over="ignore")
    def _tilted(
        self, level: KinematicSolution, gibbs: Array, settled_mm: float
    ) -> KinematicSolution:
        """Poses of the tilted plate, from those nearly so; rows that don't settle are lost."""
        found = level.found.copy()
        if not found.any():
            return level
        limbs, poses = self._limbs().rows(found), level.values[found]
        gibbs = gibbs[:, found]
        last_mm = 0.0
        for _ in range(TILT_ROUNDS):
            moved, gibbs = self._moved(limbs, poses, gibbs)
            step, determinant, _ = self.chain.newton_step(moved, np.ascontiguousarray(poses.T))
            poses = poses + step.T
            step_mm = np.abs(step[:COORDINATES]).max(axis=0)
            size_mm = float(np.fmax.reduce(step_mm))  # of lost rows it is NaN
            if size_mm**2 <= settled_mm * last_mm:
                break
            last_mm = size_mm
        values = np.full_like(level.values, np.nan)
        values[found] = poses
        if found.all():
            self._assembled[:] = [(values, gibbs)]
        wanted = self.chain.is_wanted(limbs, np.ascontiguousarray(poses.T), determinant)
        found[found] = wanted & (step_mm < TILT_CLOSED_MM)
        return KinematicSolution.where(found, values)


def _at(poses: Array) -> Array:
    """Places (3, 1, N) of poses (N, t)."""
    return np.ascontiguousarray(poses[:, :COORDINATES].T)[:, None]


def _applied(matrices: Array, vectors: Array) -> Array:
    """Products (a, N) of matrices (a, b, N) and vectors (b, N)."""
    return np.asarray(np.einsum("abn,bn->an", matrices, vectors))


def _product(one: Array, other: Array) -> Array:
    """Products (a, c, N) of matrices (a, b, N) and (b, c, N)."""
    return np.asarray(np.einsum("abn,bcn->acn", one, other))


def _inverse(by_pose: Array) -> Array:
    """-(∂F/∂pose)⁻¹ with the poses last, (t, n, N), of (N, n, t)."""
    matrices = by_pose.transpose(1, 2, 0)
    inverse = inverse_of_four if len(matrices) > COORDINATES else inverse_of_three
    return -inverse(matrices)
