"""Effects: sources of error that are no parameter of the robot, and that a campaign may have.

Theory of operation. The table of error sources (`error_sources.py`) holds what every robot has. An
effect is what happened to one campaign: a part that changed at some shot, a stand that moved
slowly, gears whose period is unknown, joints read too late, an error for which the table has no
column. Each effect moves something of every shot i, linearly in unknowns z of its own,

    motion_i = B_i z,   z ~ N(0, ρ² 1)

where the motion is one of the joints (rad, mm), of some of the model's unknowns (tolerances), of
the point in the base frame (mm), or of the tracker's frame (mrad, mm). `ErrorModel.predict` applies
the motions exactly: a part that is 5 mm longer is assembled 5 mm longer. Unknowns z are in units of
the effect's usual size, so that its size ρ is learned as that of a group of parameters.
"""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Literal, Self

import numpy as np

from campaigns.arrays import Array, Mask
from campaigns.fit.error_sources import DEG

if TYPE_CHECKING:
    from campaigns.fit.error_model import Observations

Moved = Literal["joints", "unknowns", "point", "frame"]
FRAME = "frame"
STEP_MM = 0.2
"""Usual change of a place, a length or the frame, 1 σ."""
TURN_MRAD = STEP_MM / 3.0
"""Usual turn of a frame."""
ENCODER_RAD = 0.1 * DEG
PARTS: Mapping[str, tuple[str, ...]] = {
    "encoder": ("joint_offset",),
    "arm": ("arm",),
    "forearm": ("forearm",),
    "mount": ("x", "y", "z"),
}
"""Parts of an arm that may change, with the stems of the parameters that describe each."""
STAND_MM = 0.010
"""Usual random walk of a stand indoors from a session's first shot to its last, 1 σ an axis."""
STAND_DISTANCE_MM = 3000.0
"""Distance of a tracker over which its stand's usual turn shows as that walk."""
USUAL_STAND = (1e3 * STAND_MM / STAND_DISTANCE_MM,) * 3 + (STAND_MM,) * 3
"""Usual motion of a stand in turns (mrad) and shifts (mm)."""
WALK_MODES = 4


class Effect(ABC):
    """Effect with unknowns of its own; a frozen dataclass of each kind says which."""

    source: ClassVar[str]
    """Its row in the budget of positions."""
    smallest_size: ClassVar[float] = 0.0
    """Floor of the learned size, in usual sizes."""

    @property
    @abstractmethod
    def moves(self) -> Moved:
        """What the effect moves."""

    @property
    def log_odds(self) -> float:
        """Log prior probability of this effect against none of its kind."""
        return 0.0

    @property
    @abstractmethod
    def name(self) -> str:
        """Name, unique in a model: also that of the group whose size is learned."""

    @property
    @abstractmethod
    def count(self) -> int:
        """Number of unknowns z."""

    @abstractmethod
    def basis(self, observations: "Observations") -> Array:
        """Return the motion of each shot by each unknown, (N, moved quantities, k)."""

    @property
    def sizes_of(self) -> tuple[tuple[str, int], ...]:
        """Groups of unknowns, in order, that have a size of their own: name and count."""
        return ((self.name, self.count),)

    def retuned(self, z: Array) -> tuple["Effect", Array]:
        """Return the effect linearised at unknowns z (k,), and the unknowns as it has them."""
        return self, z


@dataclass(frozen=True, slots=True)
class Step(Effect):
    """Change of a part over a span of shots: of an encoder, an arm, a mount, or the frame."""

    part: str
    """`frame`, or a word of `PARTS` and the arm's number: `encoder 0`."""
    since: float
    """Moment of the first changed shot."""
    until: float
    """Moment of the first shot behind the change; infinite for a change that lasts."""
    usual: tuple[float, ...]
    """Usual change of each unknown: tolerances of parameters, mrad and mm of a frame."""
    places: tuple[int, ...]
    """Places of what changes: among the model's unknowns, or the six of a frame."""
    moved: int
    """Number of the quantities among which these places are."""
    parts: tuple[str, ...] = ()
    """Parts that explain the change nearly as well, the likeliest first."""
    log_odds: float = 0.0
    smallest_size: ClassVar[float] = 1.0
    source: ClassVar[str] = "changes"

    @property
    def moves(self) -> Moved:
        """What the part moves."""
        return "frame" if self.part == FRAME else "unknowns"

    @property
    def name(self) -> str:
        """Part and span."""
        return f"change of {self.part} from {self.since:g} to {self.until:g}"

    @property
    def count(self) -> int:
        """Number of unknowns."""
        return len(self.usual)

    @property
    def is_lasting(self) -> bool:
        """Whether the robot or the stand of today has the change."""
        return self.until == np.inf

    @property
    def by_unknowns(self) -> Array:
        """Change of each moved quantity by each unknown, (moved, k)."""
        change = np.zeros((self.moved, self.count))
        change[self.places, range(self.count)] = self.usual
        return change

    def with_names(self, before: Sequence[str], names: Sequence[str]) -> Self:
        """Return the change among unknowns of these names instead of those `before`."""
        if self.moves == "frame":
            return self
        places = tuple(names.index(before[place]) for place in self.places)
        return replace(self, places=places, moved=len(names))

    def covers(self, moments: Array) -> Mask:
        """Return which moments (N,) are within the span; an infinite one is today."""
        return np.asarray((moments >= self.since) & ((moments < self.until) | self.is_lasting))

    def basis(self, observations: "Observations") -> Array:
        """Return the usual change of each moved quantity within the span, (N, moved, k)."""
        return self.covers(observations.moment)[:, None, None] * self.by_unknowns


class StandMotion(Effect):
    """Motion of the tracker's stand, or of the robot's base: shots cannot distinguish the two.

    All have one name, so that their sizes are one, and proposals hold all of them.
    """

    source: ClassVar[str] = "stand"

    @property
    def name(self) -> str:
        """The same name in all sessions, and since a former result."""
        return "stand"

    @property
    def moves(self) -> Moved:
        """The frame."""
        return "frame"


# A random walk less its mean is Σ z_k √2 cos(kπt) / (kπ) with z_k ~ N(0, 1) (Karhunen-Loève). Four
# modes hold 87 % of its variance; what is faster is scatter or a step.
@dataclass(frozen=True, slots=True)
class Walk(StandMotion):
    """Slow motion of the tracker's stand, or of the robot's base, during a session."""

    session: int
    """Number of the session's frame."""

    @property
    def count(self) -> int:
        """Six unknowns of each mode."""
        return 6 * WALK_MODES

    @property
    def at_end(self) -> Array:
        """Return the frame's motion by each unknown at the end of the session, (6, k)."""
        return np.asarray(self._at(np.ones(1))[0])

    def basis(self, observations: "Observations") -> Array:
        """Return the frame's motion by each mode, (N, 6, 24): turns in mrad, shifts in mm."""
        is_here = observations.frame == self.session
        return np.asarray(self._at(observations.time) * is_here[:, None, None])

    def _at(self, time: Array) -> Array:
        """Return the frame's motion by each mode at times in the session, (N, 6, 24)."""
        k = np.pi * np.arange(1, WALK_MODES + 1)
        modes = np.sqrt(2.0) * np.cos(np.outer(time, k)) / k
        motions = np.einsum("nk,ij->nikj", modes, np.diag(USUAL_STAND))
        return np.asarray(motions.reshape(len(time), 6, -1))


# Its size is learned with a half-Cauchy prior, whose tail is long: a bump of millimetres frees the
# frame from the former one.
@dataclass(frozen=True, slots=True)
class StandSince(StandMotion):
    """Motion of the tracker's stand, or of the robot's base, since a former result."""

    smallest_size: ClassVar[float] = 1.0

    @property
    def count(self) -> int:
        """Three turns and three shifts."""
        return len(USUAL_STAND)

    def basis(self, observations: "Observations") -> Array:
        """Return the usual motion of the frame, alike for all shots, (N, 6, 6)."""
        return np.broadcast_to(np.diag(USUAL_STAND), (len(observations), 6, 6))


# By the rate ω the wave a sin ωq + b cos ωq changes by q (a cos ωq - b sin ωq): a column of its own
# once amplitudes are known, linearised again at each estimate of the rate.
@dataclass(frozen=True, slots=True)
class Ripple(Effect):
    """Periodic error of drives, of one rate, in some of the arms."""

    arms: tuple[int, ...]
    rate: float
    """rad per rad or per mm of the joint."""
    rate_std: float
    """1 σ of the rate before the fit: a step of the grid on which it was found."""
    usual: float
    """Usual amplitude, rad or mm."""
    rate_log_odds: float
    """Log prior probability of this rate in these arms against no ripple."""
    amplitudes: tuple[float, ...] = ()
    """Sine and cosine of each arm at which the rate's column is linearised, in usual amplitudes."""
    source: ClassVar[str] = "periods"

    @property
    def moves(self) -> Moved:
        """The joints."""
        return "joints"

    @property
    def log_odds(self) -> float:
        """One rate of the grid, and one choice of arms."""
        return self.rate_log_odds

    @property
    def name(self) -> str:
        """Arms and place of the rate on its grid, which retuning leaves as they are."""
        return f"ripple of {','.join(map(str, self.arms))} near {self.rate / self.rate_std:.0f}"

    @property
    def count(self) -> int:
        """Sine and cosine of each arm, and the rate."""
        return 2 * len(self.arms) + 1

    @property
    def sizes_of(self) -> tuple[tuple[str, int], ...]:
        """The amplitudes have a learned size, the rate keeps its prior."""
        return ((self.name, self.count - 1), ("", 1))

    def basis(self, observations: "Observations") -> Array:
        """Return the waves of each arm's joint, and their change by the rate, (N, n, k)."""
        joints = observations.joints
        basis = np.zeros((*joints.shape, self.count))
        amplitudes = np.reshape(self.amplitudes or (0.0,) * (self.count - 1), (-1, 2))
        for number, (arm, (sine, cosine)) in enumerate(zip(self.arms, amplitudes, strict=True)):
            q = joints[:, arm]
            s, c = np.sin(self.rate * q), np.cos(self.rate * q)
            basis[:, arm, 2 * number], basis[:, arm, 2 * number + 1] = s, c
            basis[:, arm, -1] = self.rate_std * q * (sine * c - cosine * s)
        return np.asarray(self.usual * basis)

    def retuned(self, z: Array) -> tuple[Self, Array]:
        """Return the ripple at the estimated rate and amplitudes, its rate no longer off."""
        rate = self.rate + self.rate_std * float(z[-1])
        tuned = replace(self, rate=rate, amplitudes=tuple(z[:-1].tolist()))
        return tuned, np.append(z[:-1], 0.0)


@dataclass(frozen=True, slots=True)
class RateError(Effect):
    """Error of the rate of a ripple that is the robot's own."""

    arms: tuple[int, ...]
    rate: float
    """rad per rad or per mm of the joint, as the robot has it."""
    rate_std: float
    """1 σ of the rate before the fit."""
    amplitudes: tuple[float, ...]
    """Sine and cosine of each arm, rad or mm, at which the rate's column is linearised."""
    ripple_log_odds: float
    """Log prior probability of the ripple against none, as the search for it had."""
    source: ClassVar[str] = "periods"

    @property
    def name(self) -> str:
        """Arms, for no joint has two rates of its own."""
        return f"rate of {','.join(map(str, self.arms))}"

    @property
    def moves(self) -> Moved:
        """The joints."""
        return "joints"

    @property
    def count(self) -> int:
        """The rate."""
        return 1

    @property
    def sizes_of(self) -> tuple[tuple[str, int], ...]:
        """The rate keeps its prior."""
        return (("", 1),)

    def basis(self, observations: "Observations") -> Array:
        """Return the change of the waves of each arm's joint by the rate, (N, n, 1)."""
        basis = np.zeros((*observations.joints.shape, 1))
        for arm, (sine, cosine) in zip(
            self.arms, np.reshape(self.amplitudes, (-1, 2)), strict=True
        ):
            q = observations.joints[:, arm]
            slope = sine * np.cos(self.rate * q) - cosine * np.sin(self.rate * q)
            basis[:, arm, 0] = self.rate_std * q * slope
        return basis


@dataclass(frozen=True, slots=True)
class Lag(Effect):
    """Joints read before the arms had arrived: behind by a share of their last way."""

    joints: int
    """Number of joints."""
    usual: ClassVar[float] = 1e-3
    """Usual share of the way."""
    source: ClassVar[str] = "lag"

    @property
    def moves(self) -> Moved:
        """The joints."""
        return "joints"

    @property
    def name(self) -> str:
        """Name of the one lag of a campaign."""
        return "lag"

    @property
    def count(self) -> int:
        """A share for each joint."""
        return self.joints

    def basis(self, observations: "Observations") -> Array:
        """Return the usual share of each joint's way from the shot before, (N, n, n)."""
        way = observations.former - observations.joints
        return np.asarray(self.usual * way[:, :, None] * np.eye(self.joints))


# Gaussian process with the Matérn kernel of order 3/2: continuous errors with a continuous slope.
# With K = U Λ U' over the shots, the functions φ(p) = k(p, shots) U Λ^-½ make K ≈ φ φ', so that the
# process is Σ z φ with z ~ N(0, ρ²) at the shots and, the same functions, anywhere else. Functions
# beyond 99.9 % of the variance are left out.
@dataclass(frozen=True, slots=True, eq=False)
class Layer(Effect):
    """Smooth error of the whole workspace or of each arm's angle that the model has no column for.

    `place`: the point moves, by its place; a size for each direction. `arms`: each joint moves, by
    its own angle; one size.
    """

    kind: Literal["place", "arms"]
    length: float
    """Correlation length: mm of places, rad or mm of joints."""
    usual: float
    """Usual size: mm of points, rad or mm of joints."""
    shots: tuple[Array, ...]
    """Coordinates of the shots: one array of places (M, c), mm; an array (M, 1) of each joint."""
    scaled: tuple[Array, ...]
    """U Λ^-½ (M, k) of the kernel over each of these arrays."""
    turn_mm: float = 1.0
    """Length that compares with a turn of the platform by 1 rad, mm."""
    log_odds: float = 0.0
    source: ClassVar[str] = "layer"

    @classmethod
    def over(
        cls,
        kind: Literal["place", "arms"],
        shots: tuple[Array, ...],
        length: float,
        usual: float,
        turn_mm: float = 1.0,
    ) -> Self:
        """Return a layer over coordinates of shots, with the functions of its kernel."""
        scaled = tuple(_kernel_functions(_matern(at, at, length)) for at in shots)
        return cls(kind, length, usual, shots, scaled, turn_mm)

    @property
    def moves(self) -> Moved:
        """What the layer moves."""
        return "point" if self.kind == "place" else "joints"

    @property
    def name(self) -> str:
        """Kind, coordinates and length."""
        return f"{self.kind} of {self.shots[0].shape[1]} by {self.length:.3g}"

    @property
    def count(self) -> int:
        """Functions, of each direction of a place or of each joint."""
        return sum(count for _, count in self.sizes_of)

    @property
    def sizes_of(self) -> tuple[tuple[str, int], ...]:
        """A size for each direction of places; one for all joints."""
        counts = [scaled.shape[1] for scaled in self.scaled]
        if self.kind == "place":
            return tuple((f"{self.name} {axis}", counts[0]) for axis in "xyz")
        return ((self.name, sum(counts)),)

    def _functions(self, joints: Array, poses: Array) -> list[Array]:
        """Return the functions φ (N, k) at joints and poses, of places or of each joint."""
        if self.kind == "place":
            here = [place_coordinates(poses, self.turn_mm)]
        else:
            here = [joint[:, None] for joint in joints.T]
        rows = zip(here, self.shots, self.scaled, strict=True)
        return [
            _matern(new[:, : at.shape[1]], at, self.length) @ scaled for new, at, scaled in rows
        ]

    def basis(self, observations: "Observations") -> Array:
        """Return the motions of points (N, 3, k) or of joints (N, n, k)."""
        return self.basis_at(observations.joints, observations.near)

    def basis_at(self, joints: Array, poses: Array) -> Array:
        """Return the motions of points (N, 3, k) or of joints (N, n, k) at joints and poses."""
        blocks = self._functions(joints, poses)
        blocks = blocks * 3 if self.kind == "place" else blocks
        basis = np.zeros((len(joints), len(blocks), self.count))
        place = 0
        for row, block in enumerate(blocks):
            basis[:, row, place : place + block.shape[1]] = block
            place += block.shape[1]
        return self.usual * basis

    def unseen_share(self, observations: "Observations") -> Array:
        """Return the share of the process's variance that no shot determines, (N, 1) or (N, n)."""
        shares = [
            1.0 - (block**2).sum(axis=1)
            for block in self._functions(observations.joints, observations.near)
        ]
        return np.asarray(np.clip(np.stack(shares, axis=1), 0.0, 1.0))


def _kernel_functions(kernel: Array) -> Array:
    """Return U Λ^-½ (M, k) of a kernel (M, M), without the last 0.1 % of its variance."""
    values, vectors = np.linalg.eigh(kernel)
    kept = np.cumsum(values) > 1e-3 * values.sum()
    return np.asarray(vectors[:, kept] / np.sqrt(values[kept]))


def place_coordinates(poses: Array, turn_mm: float) -> Array:
    """Return the coordinates (N, t) of poses by which places are compared, mm."""
    scale = np.ones(poses.shape[1])
    scale[3:] = turn_mm
    return np.asarray(poses * scale)


def _matern(a: Array, b: Array, length: float) -> Array:
    """Return the Matérn kernel of order 3/2 between rows (N, c) and (M, c)."""
    squares = sum((x[:, None] - y) ** 2 for x, y in zip(a.T, b.T, strict=True))
    distance = np.sqrt(squares) * (3.0**0.5 / length)
    return np.asarray((1.0 + distance) * np.exp(-distance))
