"""Mechanisms as fit, plan and files see them: what each kind states, and what follows for all.

`ClosedChain` states the methods of `Mechanism` for parallelograms under a plate that tilts,
`ImplicitMechanism` for closures of any kind.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Self

import numpy as np

from campaigns.arrays import Array, Index, Mask
from campaigns.kinematics import transmission
from campaigns.kinematics.axes import Axis
from campaigns.kinematics.limbs import STEP, Fields
from campaigns.kinematics.parameters import ParameterTable
from campaigns.kinematics.platforms import Place
from campaigns.kinematics.rotations import matrices_of, turns_of_changes

TYPICAL_RADIUS_MM = 100.0


@dataclass(frozen=True, eq=False)
class Assembly:
    """Poses that joints assemble to."""

    unknowns: Array
    """Plate's pose without its sag, and its tilt if parts are imperfect, (N, t) or (N, t + 3); NaN
    where no assembly is found."""
    poses: Array
    """Poses of the controlled point, of plates with parts those of the measured point, (N, t)."""
    points: Array
    """Places of the measured point in the base frame, (N, 3)."""
    is_solved: Mask
    """Rows with an assembly, (N,)."""


@dataclass(frozen=True, eq=False)
class Margins:
    """Margins of poses from limits of the mechanism itself; NaN in rows without joints."""

    singular_value: Array
    """Smallest singular value of the closures' Jacobian, of rows of unit length, (N,)."""
    swing_rad: Array
    """Angle of each forearm out of its arm's plane, or away from its rail, (N, n) or (N, 0)."""
    elbow: Array
    """Smallest share of a forearm along which its joint moves it, (N,); 1 without forearms."""
    is_above: Mask
    """Poses above their elbows, which are another assembly, (N,)."""


class Mechanism(ABC):
    """Kind of robot: joints, task axes, parameters and how they belong together.

    It has no state: a robot is a vector p (P,) of the parameters in its table. Joints (N, n) and
    poses (N, t) are batches, in rad and mm. `approach` (N, n) holds the signs of the joints' last
    motions, 0 where they are unknown.
    """

    name: str
    """Its word in robot files."""
    rates: tuple[float, ...]
    """Repetition of each joint's ripple in the unit of `parameters.rate`: periods a turn, or mm; 0
    where it is unknown. () becomes 0 for every joint."""
    held_by_paper: tuple[str, ...]
    """Parameters, or fields of all arms, that the paper's method holds at nominal, and a parameter
    set for a plain controller as identified."""
    has_forearms: ClassVar[bool] = False
    """Whether forearms swing, stretch and bound the reach."""

    # --- what each kind states ------------------------------------------------------------------

    @property
    @abstractmethod
    def joints(self) -> tuple[Axis, ...]:
        """Axes of the joints: `q0`, `q1` and so on."""

    @property
    @abstractmethod
    def task(self) -> tuple[Axis, ...]:
        """Task axes: x, y and z of the controlled point, then no, one or three turns.

        Along a fixed axis it does not move. One turn is about z; three are a rotation vector in the
        base frame.
        """

    @property
    @abstractmethod
    def parameters(self) -> ParameterTable:
        """Table of the parameters."""

    @abstractmethod
    def assemble(
        self, p: Array, joints: Array, near: Array | None = None, approach: Array | None = None
    ) -> Assembly:
        """Solve for the poses of encoder readings (N, n).

        `near` are poses close by, (N, t), or an earlier assembly's unknowns; where they lead
        nowhere, the search begins at guesses.
        """

    @abstractmethod
    def inverse(self, p: Array, poses: Array, approach: Array | None = None) -> tuple[Array, Mask]:
        """Return the encoder readings (N, n) of poses (N, t), and which rows are solved."""

    @abstractmethod
    def jacobian(
        self, p: Array, joints: Array, poses: Array, approach: Array | None = None
    ) -> Array:
        """Return d(pose)/dp (N, t, P) at fixed encoder readings (N, n), of the poses there.

        `poses` are (N, t), or the unknowns of an assembly. Raise `LinAlgError` at a singular pose.
        """

    @abstractmethod
    def margins(self, p: Array, joints: Array, poses: Array) -> Margins:
        """Return the margins of poses (N, t) at joints (N, n)."""

    @abstractmethod
    def growth_columns(self, p: Array, by_p: Array, joints: Array) -> Array:
        """Return ∂position (N, 3, 3) by the relative growth of arms or rails, forearms, and frame.

        `by_p` (N, 3, P) are the derivatives of positions by parameters.
        """

    @abstractmethod
    def fields_of(self, p: Array) -> Fields:
        """Return the parameters of all arms by stem, (1, n)."""

    @abstractmethod
    def placed(
        self, p: Array, plate_joints_mm: tuple[Place, ...] | None, reflector_mm: Place | None
    ) -> Self:
        """Return this mechanism with places on its platform; None: where they are typically.

        Places are seen from the controlled point, of a platform that is not turned.
        """

    def with_home(self, pose: Array) -> Self:  # noqa: ARG002 - most kinds know their assembly
        """Return this mechanism with a pose (t,) well inside the workspace, mm and rad."""
        return self

    @property
    def is_planar(self) -> bool:
        """Whether the robot moves in the plane of its base's x and y alone."""
        return any(axis.is_fixed for axis in self.task)

    @property
    def line_axes(self) -> tuple[str, ...]:
        """Names of the axes along which the controlled point moves."""
        return tuple(axis.name for axis in self.task[:3] if not axis.is_fixed)

    def home_at(self, place_mm: Sequence[float]) -> Array:
        """Return the pose (t,) at a place, turned as in the middle of the workspace."""
        pose = np.zeros(len(self.task))
        pose[:3] = place_mm
        return pose

    # --- what may differ ------------------------------------------------------------------------

    @property
    def out_of_reach(self) -> str:
        """Words for a pose that no joints reach."""
        return "out of reach: no joints lead to this pose"

    @property
    def words_of_swing(self) -> tuple[str, str]:
        """Direction in which a forearm's swing is counted, and name of its upper end."""
        return "out of its arm's plane", "elbow"

    @property
    def halves(self) -> tuple[int | None, ...]:
        """Parts of the platform on which the reflector may sit instead; None: between them."""
        return ()

    @property
    def is_between_halves(self) -> bool:
        """Whether the measured point is on no part that arms end in."""
        return False

    @property
    def is_elsewhere(self) -> bool:
        """Whether the measured point is on another part than the controlled point."""
        return False

    def seen_from(self, part: int | None) -> Self:
        """Return this mechanism with the measured point on a part; None: as controlled.

        Raise `ValueError` for a part that it does not have.
        """
        if part is not None:
            raise ValueError(f"a platform of one part has no part {part}")
        return self

    def body(self, part: int | None) -> Self:
        """Return this mechanism seen from a part's own point, whatever the shots' reflector was."""
        return self.seen_from(part)

    # A frame that is fitted to shots takes up what is constant of their reflector's place.
    def reflector_in_frames(self, p: Array) -> tuple[Array, Array]:
        """Return what frames of shots took up, (3,) mm in the base frame, and by p, (3, P)."""
        return np.zeros(3), np.zeros((3, len(p)))

    # --- points ---------------------------------------------------------------------------------

    def points(self, poses: Array) -> Array:
        """Return the places of the measured point in the base frame, (N, 3), at poses (N, t)."""
        return poses[:, :3]

    def point_rows(self, poses: Array, rows: Array) -> Array:  # noqa: ARG002 - of few kinds
        """Return derivatives of the measured point (N, 3, k) from those of poses (N, t, k)."""
        return rows[:, :3]

    def facing(self, poses: Array, direction: Array) -> Array:  # noqa: ARG002 - where parts turn
        """Return where a reflector looks at poses (N, t), (N, 3) or one for all, (3,).

        It looks in a direction (3,) in the middle of the workspace.
        """
        return direction

    # --- turns ----------------------------------------------------------------------------------

    def turn_jacobian(
        self, p: Array, joints: Array, unknowns: Array, approach: Array | None = None
    ) -> Array:
        """Return the turn of the tool by parameters, (N, 3, P), rad about the base's axes.

        It is that at fixed encoder readings (N, n), at an assembly's unknowns (N, k).
        """
        return self.turn_rows(unknowns, self.jacobian(p, joints, unknowns, approach))

    def tool_axes(self, poses: Array) -> Array:
        """Return the axes of the tool as the columns of matrices (N, 3, 3).

        `poses` are (N, t), or the unknowns of an assembly with the tilt of its plate, (N, t + 3).
        """
        turns, size = np.zeros((len(poses), 3)), len(self.task)
        turns[:, 6 - size :] = poses[:, 3:size]
        axes = matrices_of(turns)
        has_tilt = poses.shape[1] > size
        return matrices_of(poses[:, size:]) @ axes if has_tilt else axes

    # The turn about z of a platform with one turn, and of one with three the turn that a change of
    # its rotation vector makes.
    def turn_rows(self, poses: Array, rows: Array) -> Array:
        """Return derivatives of the platform's turn (N, 3, k), rad about the base's axes.

        `rows` (N, t, k) are those of poses (N, t).
        """
        size = len(self.task)
        if size == 6:
            return np.asarray(turns_of_changes(poses[:, 3:size]) @ rows[:, 3:size])
        about = np.zeros((len(rows), 3, rows.shape[2]))
        about[:, 6 - size :] = rows[:, 3:size]
        return about

    # --- joints ---------------------------------------------------------------------------------

    @property
    def joint_scales(self) -> Array:
        """Travel of each joint that compares with one radian of a crank, (n,), rad or mm."""
        return np.array([axis.scale for axis in self.joints])

    def travel(self, angle_rad: float) -> float | Array:
        """Return the travel of joints that compares with a crank's angle: of all, or one of each.

        Joints of both kinds have one each, (n,), rad or mm.
        """
        scales = self.joint_scales
        return angle_rad * (scales if np.ptp(scales) else float(scales[0]))

    @property
    def rate(self) -> float:
        """Rate that all joints have in common; 0 if it is unknown or the rates differ."""
        return self.rates[0] if len({*self.rates}) == 1 else 0.0

    @property
    def rates_are_of_turns(self) -> bool:
        """Whether rates of ripples are periods a turn, else mm a period."""
        return self.parameters.rate.unit != "mm"

    @cached_property
    def rippling(self) -> Index:
        """Arms whose drives the table lets ripple, (k,)."""
        rows = (self.parameters.rows[place] for place in self._columns.get("ripple_sin", ()))
        return np.array([row.arm for row in rows if row.arm is not None], dtype=np.intp)

    def has_ripple(self, arm: int | None) -> bool:
        """Return whether a joint's ripple has a rate; for None, whether any joint's has."""
        return any(self.rates) if arm is None else self.rates[arm] != 0.0

    @cached_property
    def phase_rate(self) -> Array:
        """Change N of each ripple's phase with its reading, (n,): rad over rad, or over mm."""
        rates = np.array(self.rates)
        if not self.rates_are_of_turns:
            rates[rates != 0.0] = 2.0 * np.pi / rates[rates != 0.0]
        # files give cranks the periods in a turn, which is N itself
        return rates

    def with_ripples(self, rates: float | Sequence[float]) -> Self:
        """Return this mechanism with ripples that repeat at these rates.

        `rates` are in the unit of `parameters.rate`: one for all joints or one for each, 0 for a
        joint without a ripple. Raise `ValueError` for another number of rates.
        """
        if not isinstance(rates, Sequence):
            rates = (float(rates),) * len(self.joints)
        return replace(self, rates=tuple(map(float, rates)))  # type: ignore[type-var]

    def _checked_rates(self) -> tuple[float, ...]:
        """Return the rates, 0 for each joint if there are none; raise `ValueError` for others."""
        rates = self.rates or (0.0,) * len(self.joints)
        if len(rates) != len(self.joints):
            raise ValueError(f"{len(rates)} ripple rates for {len(self.joints)} joints")
        return rates

    def true_joints_at(self, p: Array, joints: Array, approach: Array | None = None) -> Array:
        """Return where joints are, less their offsets, at encoder readings (N, n)."""
        return transmission.true_joints(self.fields_of(p), joints, approach, self.phase_rate)

    # The sum of the terms' largest derivatives: |k|, |a|, |b|, N |c|, N |d|, and 0 of backlash.
    def steepest_error(self, p: Array) -> float:
        """Return a bound of the change of any joint's error over its motion."""
        fields = self.fields_of(p)
        by_phase = dict.fromkeys(("ripple_sin", "ripple_cos"), self.phase_rate)
        by_phase["backlash"] = np.zeros(1)
        bounds = [
            np.abs(by_phase.get(stem, np.ones(1)) * fields[stem])
            for stem in transmission.STEMS
            if stem in fields
        ]
        return float(np.sum(bounds, axis=0).max(initial=0.0))

    def joint_slopes(self, p: Array, joints: Array) -> Array:
        """Return the change of true joints over that of encoder readings (N, n), (N, n)."""
        stepped = self.true_joints_at(p, np.asarray(joints + 1j * STEP))
        return np.asarray(stepped.imag / STEP)

    # --- plans ----------------------------------------------------------------------------------

    @abstractmethod
    def is_mode_of_home(self, p: Array, joints: Array, poses: Array) -> Mask:
        """Return which poses (N, t) of joints (N, n) are the assembly that `assemble` looks for."""

    def reach_mm(self, p: Array, joint: tuple[float, float], swing_rad: float) -> Array:  # noqa: ARG002 - limits of the task bound it
        """Return the corners (2, 3) of a box that holds all positions; infinite if limits do.

        `joint` are the lowest and the highest joint, `swing_rad` is the limit of forearms.
        """
        return np.array([[-np.inf], [np.inf]]) * np.ones(3)

    def reach_of_turns_mm(self, p: Array) -> float:  # noqa: ARG002 - few have any
        """Return by how much a turn of 1 rad takes the controlled point farther out."""
        return 0.0

    def radius_mm(self, p: Array, turns: Array) -> float:  # noqa: ARG002 - a typical one
        """Return the distance of the platform's farthest joint from its point at turns (M, 1)."""
        return TYPICAL_RADIUS_MM

    # --- parameters -----------------------------------------------------------------------------

    @cached_property
    def free_by_paper(self) -> tuple[str, ...]:
        """Names of the geometry that the paper's method and plain parameter sets fit."""
        table, held = self.parameters, set(self.held_by_paper)
        return tuple(name for name in table.names if not {name, table[name].field.name} & held)

    @cached_property
    def _columns(self) -> Mapping[str, Index]:
        """Places in a vector (P,) by stem, without those of growth, which no robot file has."""
        size = len(self.parameters.of_robot)
        return {
            stem: places for stem, places in self.parameters.columns.items() if places[0] < size
        }
