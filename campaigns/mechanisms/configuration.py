"""Closed chains at given joints: assembled and differentiated, the plate as it tilts.

Unequal rods and tilted axes tilt the plate by milliradians (`parasitic_rotation.py`), and the tilt
moves the plate's joints. Seen from the measured point that is the level chain with its elbows moved
the other way: a few rounds of tilt and pose agree to rounding.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from campaigns.arrays import Array, Mask
from campaigns.mechanisms.arms import Arms
from campaigns.mechanisms.mechanism import KinematicSolution
from campaigns.mechanisms.parasitic_rotation import (
    RodPairs,
    TiltedForearms,
    displacement,
    inverse_of_three,
)

if TYPE_CHECKING:
    from campaigns.mechanisms.closed_chain import ClosedChain

COORDINATES = 3
AZIMUTH, FOREARM = 3, 6
"""Places among the fields of an arm of any kind."""
CONVERGED_MM = 1e-5
"""A Newton step shorter than this leaves an error of its square over the forearm's length."""
TILT_ROUNDS = 30
ROUNDS_AT_ONCE = 10
"""From poses and tilts near by; where these don't settle, a level plate is assembled first."""
TILT_SETTLED_PER_MM = 0.001
"""Last step of poses and tilts in turn over the square of that of poses alone.

Each leaves a thousandth; that of poses alone leaves its square over the forearm's length.
"""
TILT_CLOSED_MM = 1e-4
NEARLY_MM = 1e-1
"""Step at which a level plate is near enough to be tilted."""


@dataclass(frozen=True, slots=True, eq=False)
class Limbs:
    """Elbows by component (3, n, N), forearm lengths (n, 1 or N), platform fields (f, 1 or N)."""

    elbows_mm: Array
    forearm_mm: Array
    platform: Array
    assembly_sign: Array
    """Sign of the determinant of the closures' Jacobian at home, (1 or N,): the assembly mode."""

    def rows(self, chosen: Mask) -> "Limbs":
        """Limbs of some of the rows."""
        one = self.assembly_sign.shape == (1,)  # robot of all rows
        own = (self.forearm_mm, self.platform, self.assembly_sign)
        return Limbs(
            self.elbows_mm[:, :, chosen], *(own if one else (each[..., chosen] for each in own))
        )


@dataclass(frozen=True, slots=True, eq=False)
class Configuration:
    """Arms of a closed chain at joints (N, n), and the platform's fields, (f, 1 or N)."""

    chain: "ClosedChain"
    platform: Array
    arms: Arms
    pairs: RodPairs
    assembly_sign: Array
    """(1 or N,)"""
    _assembled: list[tuple[Array, Array]] = field(default_factory=list)
    """Poses last assembled, and the plate's tilt there."""

    @property
    def last_tilt(self) -> Array | None:
        """Tilt of the plate where it was last assembled, for `assemble` of joints near these."""
        return self._assembled[0][1] if self._assembled else None

    def assemble(
        self,
        near: Array | None = None,
        converged_mm: float = CONVERGED_MM,
        tilt: Array | None = None,
    ) -> KinematicSolution:
        """Poses (N, t) of the joints, from poses and a tilt near them.

        A step below `converged_mm` is the last one.
        """
        limbs = self._limbs()
        if self.pairs.are_level:
            return self.chain.assemble(limbs, near, converged_mm)
        settled_mm = TILT_SETTLED_PER_MM * converged_mm**2
        gibbs = np.zeros((COORDINATES, limbs.elbows_mm.shape[2]))
        if near is None:
            level = self.chain.assemble(limbs, None, NEARLY_MM)
            return self._tilted(level, gibbs, settled_mm)
        at_once = KinematicSolution.where(np.ones(len(near), dtype=bool), near.copy())
        start_tilt = gibbs if tilt is None else tilt
        found = self._tilted(at_once, start_tilt, settled_mm, at_once=True)
        if found.found.all():
            return found
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
        ends = self.chain.platform.joints_mm(self.platform, poses)
        return np.ascontiguousarray(ends.T) - self.arms.elbows_mm

    def tilted_forearms(self, poses: Array) -> TiltedForearms:
        """A_iB_i at poses (N, t) of the plate as it tilts there."""
        return self.pairs.state(*self._seen(self.arms.elbows_mm, poses), self.tilt(poses))

    def by_pose(self, poses: Array, forearms_mm: Array, on_plate_mm: Array | None = None) -> Array:
        """∂F/∂pose, (N, n, t), from forearms (3, n, N), and these as seen from a tilted plate."""
        chain = self.chain
        _, arms, rows = forearms_mm.shape
        jacobian = np.zeros((rows, arms, len(chain.task)))
        jacobian[:, :, :COORDINATES] = 2.0 * forearms_mm.T
        if len(chain.task) > COORDINATES:
            seen = forearms_mm if on_plate_mm is None else on_plate_mm
            by_turn = chain.platform.by_turn(self.platform, poses, seen)
            jacobian[:, :, COORDINATES] = by_turn.T
        return jacobian

    def jacobian(self, poses: Array, *, extended: bool = True) -> Array:
        """d(pose)/dp (N, t, G) at fixed joints, of the poses that they assemble to.

        The columns of extensions are left 0 where they are not asked for and the plate is level.
        """
        if self.pairs.are_level and not extended:
            forearms = self.forearms_mm(poses)
            by_platform = self._by_platform(poses, forearms)
            by_closure = _inverse(self.by_pose(poses, forearms))
            by_all = self._by_all(by_closure, self.arms.by_fields(forearms), by_platform)
            by_all[:, len(self.chain.parameters.names) :] = 0.0
            return by_all.transpose(2, 0, 1)
        return self._tilting_jacobian(poses)

    def _tilting_jacobian(self, poses: Array) -> Array:
        """Jacobian without the plate's tilt: closures F and its normal equations H both vanish.

        dF = F_z dz + F_s ds + F_p dp and dH alike give ds, and with C = -F_s H_s⁻¹
        dz = -(F_z + C H_z)⁻¹ (F_p + C H_p).
        """
        state = self.tilted_forearms(poses)
        by_forearms = state.normal_by_forearms()
        back = state.rotated_back(state.forearms_mm)
        by_pose = self.by_pose(poses, state.forearms_mm, back)
        by_turn = state.normal_by_turn(by_forearms)
        eliminated = -_product(state.closures_by_turn().swapaxes(0, 1), inverse_of_three(by_turn))
        turned = [state.rotated_back(each) for each in by_forearms]
        normal_by_pose = [
            0.5 * self.by_pose(poses, *each).sum(axis=1).T
            for each in zip(by_forearms, turned, strict=True)
        ]
        by_pose += _product(eliminated, np.stack(normal_by_pose)).transpose(2, 0, 1)
        by_closure = _inverse(by_pose)
        by_normal = _product(by_closure, eliminated)
        # derivatives by fields are linear in the forearms: one call for both
        seen = zip(
            self._weighted(by_closure, by_normal, state.forearms_mm, by_forearms),
            self._weighted(by_closure, by_normal, back, turned),
            strict=True,
        )
        by_all, by_arms, by_plate, beyond = self._columns(by_closure)
        fields = by_arms.shape[2]
        for row, (forearms, on_plate) in enumerate(seen):
            own = self.arms.by_fields(forearms)
            by_arms[row], beyond[row, :-1] = own[:, :fields], own[:, fields:].swapaxes(0, 1)
            by_plate[row] = self._by_platform(poses, on_plate).sum(axis=1)
        self._add_own(state, by_closure, by_normal, by_arms, beyond)
        return by_all.transpose(2, 0, 1)

    @staticmethod
    def _weighted(
        by_closure: Array, by_normal: Array, forearms_mm: Array, rows: Sequence[Array] | Array
    ) -> list[Array]:
        """Forearms (3, n, N) of each task coordinate whose derivatives are that coordinate's."""
        first, second, third = rows
        return [
            closure * forearms_mm
            + (0.5 * balance[0]) * first
            + (0.5 * balance[1]) * second
            + (0.5 * balance[2]) * third
            for closure, balance in zip(by_closure, by_normal, strict=True)
        ]

    def _add_own(
        self,
        state: TiltedForearms,
        by_closure: Array,
        by_normal: Array,
        by_arms: Array,
        beyond: Array,
    ) -> None:
        """Add what does not go through the forearms: lengths, and the directions of bars."""
        by_own = (_product(by_normal, each) for each in state.by_own_parameters())
        by_azimuth, by_forearm, by_axis_tilt, by_skew = by_own
        if self.chain.plate.outward_rad is None:
            by_arms[:, :, AZIMUTH] += by_azimuth
        lengths = -2.0 * by_closure * self.pairs.forearm_mm
        by_arms[:, :, FOREARM] = lengths + by_forearm
        beyond[:, -2] += by_axis_tilt
        beyond[:, -1] = by_skew

    def _by_platform(self, poses: Array, forearms_mm: Array) -> Array:
        return self.chain.platform.by_fields(self.platform, poses, forearms_mm)

    def _by_all(self, by_closure: Array, own: Array, by_platform: Array) -> Array:
        """d(pose)/dp (t, G, N) of parameters that enter their own arm's closure alone."""
        by_all, by_arms, by_plate, beyond = self._columns(by_closure)
        fields = by_arms.shape[2]
        np.multiply(by_closure[:, :, None], own[:, :fields], out=by_arms)
        for place, each in enumerate(by_platform):
            by_plate[:, place] = (by_closure * each).sum(axis=1)
        tilts = own[:, fields:].swapaxes(0, 1)
        np.multiply(by_closure[:, None], tilts, out=beyond[:, : len(tilts)])
        return by_all

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
        ends = self.chain.platform.joints_mm(self.platform, poses)
        from_point = (ends - poses[:, None, :COORDINATES]).T
        return np.ascontiguousarray(ends.T) - elbows_mm, self.chain.plate.seen_mm(from_point)

    def _moved(self, limbs: Limbs, poses: Array, gibbs: Array) -> tuple[Limbs, Array]:
        """Limbs that hold a level plate where the tilted one is, and its Gibbs vectors (3, N).

        These are some thousand times nearer to the plate's than those given.
        """
        forearms, seen = self._seen(limbs.elbows_mm, poses)
        gibbs, _ = self.pairs.approached(forearms, seen, gibbs)
        return replace(limbs, elbows_mm=limbs.elbows_mm - displacement(gibbs, seen)), gibbs

    @np.errstate(divide="ignore", invalid="ignore", over="ignore")
    def _tilted(
        self, level: KinematicSolution, gibbs: Array, settled_mm: float, *, at_once: bool = False
    ) -> KinematicSolution:
        """Poses of the tilted plate, from those nearly so; rows that don't settle are lost."""
        found = level.found.copy()
        if not found.any():
            return level
        limbs, poses = self._limbs().rows(found), level.values[found]
        gibbs = gibbs[:, found]
        step_mm = np.full(len(poses), np.inf)
        for _ in range(ROUNDS_AT_ONCE if at_once else TILT_ROUNDS):
            moved, gibbs = self._moved(limbs, poses, gibbs)
            step, determinant, _ = self.chain.newton_step(moved, np.ascontiguousarray(poses.T))
            poses = poses + step.T
            step_mm = np.abs(step[:COORDINATES]).max(axis=0)
            if not step_mm.max() > settled_mm:
                break
        values = np.full_like(level.values, np.nan)
        values[found] = poses
        if found.all():
            self._assembled[:] = [(values, gibbs)]
        wanted = self.chain.is_wanted(limbs, np.ascontiguousarray(poses.T), determinant)
        found[found] = wanted & (step_mm < (settled_mm if at_once else TILT_CLOSED_MM))
        return KinematicSolution.where(found, values)


def _product(one: Array, other: Array) -> Array:
    """Products (a, c, N) of matrices (a, b, N) and (b, c, N)."""
    return np.asarray((one[:, :, None] * other).sum(axis=1))


def _inverse(by_pose: Array) -> Array:
    """-(∂F/∂pose)⁻¹ with the poses last, (t, n, N), of (N, n, t)."""
    return -np.ascontiguousarray(np.linalg.inv(by_pose).transpose(1, 2, 0))
