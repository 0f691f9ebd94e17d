"""The mechanism's rods, bars and platform, of whatever kind: six or eight rods hold it.

Theory of operation. Joints come in; where the platform is comes out:

1. each joint places its elbow (crank's end or carriage) and, by the bar there, the upper ends of
   its arm's two rods; tilted axes, leaning rails and warm parts are in these places;
2. the platform has six unknowns, position and orientation, and a seventh where it has an inner
   joint; they place the lower ends of the rods;
3. each rod's misfit is the distance of its ends less its own length. There is one rod more than
   unknowns (eight for seven) or as many (six for six). Equally stiff rods share the strain so that
   the sum of squared misfits is least: Gauss-Newton on all rods finds the platform near a guess.

The estimator's model has neither single rods nor a finite orientation: it closes the mean rod of an
arm by squares of distances, and its plate tilts by a small rotation vector. With equal rods and
level axes both describe one mechanism, which a test holds to 1e-9 mm; that test is all they share.

The file begins with rotations by three angles about fixed axes, and their derivatives.
"""

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import NamedTuple, Self

import numpy as np
from typing_extensions import override

from sim.errors import AssemblyLost
from sim.geometry import UP, Array, Geometry, Kind, PlateKind


def _about(axis: int, angle_rad: float) -> tuple[Array, Array]:
    """Return the rotation about one axis and its derivative."""
    first, second = (axis + 1) % 3, (axis + 2) % 3
    cosine, sine = math.cos(angle_rad), math.sin(angle_rad)
    both = np.zeros((2, 3, 3))
    turn, rate = both
    turn[axis, axis] = 1.0
    turn[first, first] = turn[second, second] = cosine
    turn[first, second], turn[second, first] = -sine, sine
    rate[first, first] = rate[second, second] = -sine
    rate[first, second], rate[second, first] = -cosine, cosine
    return turn, rate


def rotation(about_x: float, about_y: float, about_z: float) -> Array:
    """Return the rotation (3, 3) about x, then y, then z of the fixed frame, by angles in rad."""
    return np.asarray(_about(2, about_z)[0] @ _about(1, about_y)[0] @ _about(0, about_x)[0])


def rotation_and_rates(about_x: float, about_y: float, about_z: float) -> tuple[Array, Array]:
    """Return the rotation (3, 3) and its derivatives (3, 3, 3) by the three angles."""
    (x, dx), (y, dy), (z, dz) = _about(0, about_x), _about(1, about_y), _about(2, about_z)
    # product rule on Z Y X: each derivative replaces one of the three factors
    zy = z @ y
    return zy @ x, np.array([zy @ dx, z @ dy @ x, dz @ y @ x])


RADIAN_AS_MM = 100.0
"""Length by which a step in angle is compared with one in position."""
SETTLED_MM = 1e-9
"""A last step this small leaves an error of the size of rounding, since convergence is fast."""
MOST_ITERATIONS = 25
JOINT_STEP = 1e-6
"""Step of a joint for the derivative of the elbows' places, rad or mm."""
Z_INDEX = 2
"""Index of z among a plate's unknowns."""


class Growth(NamedTuple):
    """Relative growth of a robot's parts since they were cold."""

    arms: float = 0.0
    """Growth of cranks, or of the scales of rails."""
    forearms: float = 0.0
    """Growth of rods."""
    frame: float = 0.0
    """Growth of the distances from the base frame's origin to motors or rails."""


COLD = Growth()


@dataclass(frozen=True, slots=True, eq=False)
class Build:
    """Departures of the mechanism from its contracted model, in sizes and in errors."""

    plate_joints_mm: Array
    """(n, 3): b_i, the bars' middles on the plate from the contracted plate joints B'_i."""
    rod_spacing_mm: float
    """Distance of the two rods of an arm, the length of its bars."""
    rod_errors_mm: Array
    """(n, 2): each rod's length less its forearm's."""
    axis_tilts_rad: Array
    """(n,): turns of motor axes, or of rails with their bars, about the arm's direction outward."""
    leans_rad: Array | None = None
    """(n,): turns of rails about their bars, which leans them outward; None: no turns."""
    bar_turns_rad: Array | None = None
    """(n,): turns of the bars on the plate about z; None: no turns."""


@dataclass(frozen=True, slots=True, eq=False)
class Plate:
    """Place of the platform: controlled point, orientation, and its inner joint's turn."""

    unknowns: Array
    """(6,) or (7,): x, y, z mm; rotations about x, y, z in rad, applied in that order; θ rad."""

    @classmethod
    def level(cls, kind: PlateKind, position_mm: Array, theta_rad: float) -> Self:
        """Return a platform that is not tilted."""
        # a platform without an inner joint has six unknowns: its θ is cut off
        return cls(np.array([*position_mm, 0.0, 0.0, 0.0, theta_rad])[: kind.unknowns])

    @property
    def position_mm(self) -> Array:
        """(3,): the controlled point in the base frame."""
        return self.unknowns[:3]

    @property
    def rotation(self) -> Array:
        """(3, 3): base_from_plate, of every part that an arm's rods hold."""
        return rotation(*self.unknowns[3:6])

    @property
    def theta_rad(self) -> float:
        """Turn of the inner joint; 0 of a platform without one."""
        return float(self.unknowns[6:].sum())


class Settled(NamedTuple):
    """Platform at which the rods come to rest, and how they close there."""

    plate: Plate
    misfits_mm: Array
    """(2n,): distance of each rod's ends less its length."""
    jacobian: Array
    """(2n, u): derivative of the misfits by the platform's unknowns."""


class Mechanism(ABC):
    """A robot's parts and their closure. Holds no state: joints in, plate out."""

    kind: Kind
    """Its joints and parameters."""

    @abstractmethod
    def plate_of(self, unknowns: Array) -> Plate:
        """Return the platform with these unknowns, (u,)."""

    @abstractmethod
    def settle(
        self, joints: Array, guess: Plate, growth: Growth = COLD, settled_mm: float = SETTLED_MM
    ) -> Settled:
        """Solve the platform near a guess, until a step is below `settled_mm`.

        Raises `AssemblyLost` if that does not happen within 25 steps.
        """

    @abstractmethod
    def side(self, jacobian: Array) -> float:
        """Return a sign that changes in singularities, by a settled platform's derivative."""

    @abstractmethod
    def reflector_mm(self, plate: Plate, offset_mm: Array, half: int | None = None) -> Array:
        """Return the place (3,) of a reflector at an offset from the controlled point, on its part.

        With `half`, 1 or 2, the offset begins at the joints of that half.
        """

    @abstractmethod
    def heights_by_joints(self, joints: Array, plate: Plate) -> tuple[Array, Array]:
        """Return the rise of each joint's own part, and of the platform, by the joint, (n,) each.

        In mm per rad or mm. Times the weights there they are each joint's torque, by virtual work.
        """


class RodMechanism(Mechanism):
    """Mechanism of arms that hold a plate by two rods each."""

    def __init__(self, truth: Geometry, build: Build) -> None:
        self.kind: PlateKind = truth.kind
        self._truth = truth
        self._outward = truth.outward
        outward, sideways = truth.outward, truth.sideways
        half_bar_mm = 0.5 * build.rod_spacing_mm
        # The contracted model shifts each arm by b_i, so that its forearm ends at B'_i; the real
        # motor is b_i beside the contracted one.
        self._motors_mm = truth.motors_mm + build.plate_joints_mm
        tilts, leans = build.axis_tilts_rad, build.leans_rad
        # A tilted motor axis takes along the plane in which its crank swings, and the elbow's bar.
        # The bar on the plate does not follow: this tilts the plate.
        self._down = turned(np.tile(-UP, (self.kind.arms, 1)), outward, tilts)
        leaning = truth.rails if leans is None else turned(truth.rails, sideways, leans)
        self._rails = turned(leaning, outward, tilts)
        self._elbow_bar_mm = half_bar_mm * turned(sideways, outward, tilts)
        bars, turns = sideways, build.bar_turns_rad
        if turns is not None:
            bars = turned(bars, np.tile(UP, (self.kind.arms, 1)), turns)
        self._anchors_mm = _pairs(build.plate_joints_mm, half_bar_mm * bars)
        self._rods_mm = (truth.forearms_mm[:, None] + build.rod_errors_mm).ravel()

    @override
    def plate_of(self, unknowns: Array) -> Plate:
        return Plate(unknowns)

    def elbows_mm(self, joints: Array, growth: Growth = COLD) -> Array:
        """Return the rods' upper ends (2n, 3) in the base frame."""
        places = (joints + self._truth.joint_offsets)[:, None]
        motors_mm = (1.0 + growth.frame) * self._motors_mm
        if self.kind.on_rails:
            ways_mm = (1.0 + growth.arms) * places * self._rails
            return _pairs(motors_mm + ways_mm, self._elbow_bar_mm)
        cranks = np.cos(places) * self._outward + np.sin(places) * self._down
        lengths_mm = (self._truth.arms_mm * (1.0 + growth.arms))[:, None]
        return _pairs(motors_mm + lengths_mm * cranks, self._elbow_bar_mm)

    def misfit(
        self, elbows_mm: Array, unknowns: Array, growth: Growth = COLD
    ) -> tuple[Array, Array]:
        """Return the distances of the rods' ends less their lengths, (2n,) mm, and the derivative.

        The derivative is (2n, u), by the platform's unknowns in mm and rad.
        """
        # A rod's distance grows by the motion of its lower end along the rod alone: the derivative
        # by the position is the rod's unit vector, by an angle that vector times the end's motion.
        turn, rates = rotation_and_rates(*unknowns[3:6])
        apart_mm, apart_rate_mm = self._truth.plate_joints_apart(float(unknowns[6:].sum()))
        on_plate_mm = self._anchors_mm + np.repeat(apart_mm, 2, axis=0)
        gaps_mm = unknowns[:3] + on_plate_mm @ turn.T - elbows_mm
        lengths_mm = np.sqrt(np.einsum("ij,ij->i", gaps_mm, gaps_mm))
        along = gaps_mm / lengths_mm[:, None]
        jacobian = np.empty((len(gaps_mm), len(unknowns)))
        jacobian[:, :3] = along
        jacobian[:, 3:6] = np.einsum("ri,kij,rj->rk", along, rates, on_plate_mm)
        if self.kind.turn is not None:
            moved = np.repeat(apart_rate_mm, 2, axis=0) @ turn.T
            jacobian[:, 6] = np.einsum("ri,ri->r", along, moved)
        return lengths_mm - (1.0 + growth.forearms) * self._rods_mm, jacobian

    @override
    def reflector_mm(self, plate: Plate, offset_mm: Array, half: int | None = None) -> Array:
        # An H4's crossbar turns and takes the offset with it, unless the offset is along its axis.
        # The halves of all other platforms keep their orientation.
        if half is not None:
            arm = 0 if half == 1 else -1
            offset_mm = offset_mm + self._truth.plate_joints_apart(plate.theta_rad)[0][arm]
        elif self.kind.turns_point:
            offset_mm = _about(2, plate.theta_rad)[0] @ offset_mm
        return np.asarray(plate.position_mm + plate.rotation @ offset_mm)

    @override
    def settle(
        self, joints: Array, guess: Plate, growth: Growth = COLD, settled_mm: float = SETTLED_MM
    ) -> Settled:
        # Gauss-Newton. Angles are scaled to mm of motion while the step is computed: at a nearly
        # singular pose `lstsq` judges by singular values, which must have one unit. No step is
        # limited: callers come in small steps from a settled neighbour (`follow`) or with a guess
        # close by.
        elbows_mm = self.elbows_mm(joints, growth)
        unknowns = guess.unknowns
        for _ in range(MOST_ITERATIONS):
            misfits_mm, jacobian = self.misfit(elbows_mm, unknowns, growth)
            jacobian[:, 3:] /= RADIAN_AS_MM
            step_mm = np.linalg.lstsq(jacobian, -misfits_mm, rcond=None)[0]
            jacobian[:, 3:] *= RADIAN_AS_MM
            largest_mm = float(np.abs(step_mm).max())
            step_mm[3:] /= RADIAN_AS_MM
            unknowns = unknowns + step_mm
            if largest_mm < settled_mm:
                return Settled(Plate(unknowns), misfits_mm, jacobian)
        raise unsettled(self.kind, joints)

    @override
    def side(self, jacobian: Array) -> float:
        # The sign of the forearms' determinant by x, y, z, θ. The sum of an arm's two rods is its
        # forearm. Three or four forearms by three or four unknowns are a square matrix; the
        # orientation, which the differences of rods hold, is left out.
        rods, unknowns = jacobian.shape
        by_pose = [0, 1, 2, *range(6, unknowns)]
        forearms = jacobian.reshape(rods // 2, 2, unknowns).sum(axis=1)[:, by_pose]
        return float(np.sign(np.linalg.det(forearms)))

    @override
    def heights_by_joints(self, joints: Array, plate: Plate) -> tuple[Array, Array]:
        # 1. Misfits stay least while the elbows move: the plate's motion is the pseudo-inverse of
        #    the misfits' derivative times what the elbows' motion takes from each rod's distance.
        # 2. Of that motion only the row of z is needed.
        elbows_mm = self.elbows_mm(joints)
        _, by_plate = self.misfit(elbows_mm, plate.unknowns)
        lift = np.linalg.pinv(by_plate)[Z_INDEX]
        elbow, whole = np.empty(len(joints)), np.empty(len(joints))
        for joint in range(len(joints)):
            moved = joints.copy()
            moved[joint] += JOINT_STEP
            elbow_rates = (self.elbows_mm(moved) - elbows_mm) / JOINT_STEP
            elbow[joint] = elbow_rates[2 * joint, Z_INDEX]
            # the first three columns are the rods' unit vectors
            whole[joint] = lift @ np.einsum("ri,ri->r", by_plate[:, :3], elbow_rates)
        return elbow, whole


def unsettled(kind: Kind, joints: Array) -> AssemblyLost:
    """Return the error of joints at which no platform is found."""
    return AssemblyLost(
        f"the plate does not settle at joints {kind.listed(joints, '.3f')}",
        remedy="stay away from the edge of the robot's reach",
    )


def turned(vectors: Array, axes: Array, angles_rad: Array) -> Array:
    """Turn vectors (n, 3), each about its unit axis by its angle (Rodrigues)."""
    cosine, sine = np.cos(angles_rad)[:, None], np.sin(angles_rad)[:, None]
    along = np.einsum("ij,ij->i", axes, vectors)[:, None] * axes
    return np.asarray(along + cosine * (vectors - along) + sine * np.cross(axes, vectors))


def _pairs(centres_mm: Array, half_bars_mm: Array) -> Array:
    """Return both ends of each bar, (2n, 3), arm by arm."""
    bar_ends_mm = np.stack([centres_mm - half_bars_mm, centres_mm + half_bars_mm], axis=1)
    return np.reshape(bar_ends_mm, (-1, 3))
