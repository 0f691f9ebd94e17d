"""Maps of the columns of a file to joints: which column feeds which joint, by what factor and zero.

People swap columns, turn signs, write radians; encoders are set to zero at a homing switch, count
increments, and motors turn behind gears. All of this is one map: joint = factor · column + zero.
The maps without numbers of their own are tried one by one (`plain_maps`). The others are fitted so
that the nominal robot has the measured points at the joints, up to a rigid motion (`simplest_map`):

1. Starts lie on a grid: columns in every order and of both signs, as they are or of any spread, and
   zeros all around. A few shots sort out most of them, more shots decide which are refined.
2. Of the best, a factor and a zero for each joint are fitted by least squares, in which a few gross
   errors count little.
3. If that explains the shots, what is not needed is dropped: the simplest map that leaves no more
   than shots that were read rightly is the cause.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, permutations, product

import numpy as np
import scipy

from campaigns.arrays import Array, Index
from campaigns.evaluation.pieces import similarity_fit, spread_mm
from campaigns.fit.rigid_transforms import away_from_mean, best_rotation
from campaigns.kinematics.axes import Axis
from campaigns.kinematics.model import Kinematics
from drivers.values import JOINT_ANGLE

Causes = tuple[tuple[str, str], ...]
"""What is different from how it is written: causes in words, each with its remedy."""

MOST_IN_ANY_ORDER = 4
"""Joints up to which every order is tried."""
CENTRES = np.linspace(-1.0, 1.0, 13)[1:]
"""Means of joints on the grid, in half turns, or in `REACH` times the points' spread: the fit
converges from half of their distance."""
REACH = 6.0
SPREADS = (0.1, 0.2, 0.4, 0.8)
"""Spreads of joints on the grid, in rad, or in times the points' spread."""
SHOTS_OF_THE_GRID = 6
STARTS = 6
"""Starts that are refined, each of another order and other signs."""
OUTLIER = 0.1
"""Residual in parts of the points' spread from which on a shot counts less."""
MOST_STEPS = 15
START_MISFIT = 0.3
"""Misfit from which on a fit with other parameters finds nothing near a map."""


@dataclass(frozen=True, slots=True, eq=False)
class JointMap:
    """Map of the columns of a file to joints."""

    order: tuple[int, ...]
    """Column that feeds each joint."""
    factors: Array
    """Joint per column's value (n,)."""
    zeros: Array
    """Joint at the column's value 0, (n,), rad or mm."""

    @property
    def distance(self) -> int:
        """How many columns stand elsewhere, and how many have the other sign."""
        moved = np.array(self.order) != np.arange(len(self.order))
        return int(np.count_nonzero(moved) + np.count_nonzero(self.factors < 0.0))

    @property
    def has_one_factor(self) -> bool:
        """Whether the columns that are in another unit are all in the same one."""
        return len({*np.abs(self.factors).tolist()} - {1.0}) <= 1

    def joints(self, columns: Array) -> Array:
        """Return the joints (N, n) of columns (N, n), in rad and mm."""
        return np.asarray(self.factors * columns[:, self.order] + self.zeros)

    def causes(self, axes: Sequence[Axis], columns: Array) -> Causes:
        """Return what is different from the columns (N, n) as they are written, in words."""
        most = np.radians(JOINT_ANGLE.most)
        are_counts = [
            axis.is_revolute and bool(np.abs(columns[:, place]).max() > most)
            for axis, place in zip(axes, self.order, strict=True)
        ]
        remedy = self._remedy(axes)
        words = (
            *order_words(self.order),
            *self._factor_words(axes, are_counts),
            *self._sign_words(),
            *self._zero_words(axes),
        )
        return tuple((word, remedy) for word in words)

    def _factor_words(self, axes: Sequence[Axis], are_counts: Sequence[bool]) -> Iterator[str]:
        sizes = np.abs(self.factors)
        scaled = [place for place, size in enumerate(sizes.tolist()) if size != 1.0]
        if not scaled:
            return
        turns = [place for place, axis in enumerate(axes) if axis.is_revolute]
        is_whole = len(scaled) == len(axes)
        names = ", ".join(axes[self.order[place]].column for place in scaled)
        subject, seem = ("the joints", "seem") if is_whole else (names, "seems")
        if not self.has_one_factor:
            yield f"{subject} {seem} to be in other units"
            return
        size = float(sizes[scaled[0]])
        if scaled == turns and size == math.degrees(1.0):
            yield "the joints look like radians"
        elif all(are_counts[place] for place in scaled):
            seem = f"column {names} seems" if len(scaled) == 1 else f"columns {names} seem"
            yield f"{seem} to hold counts of an encoder: a factor of {size:.4g}° a count"
        else:
            times = (
                f"{size:.4g} times too small" if size > 1.0 else f"{1.0 / size:.4g} times too large"
            )
            yield f"{subject} {seem} to be {times}: steps, turns or another unit"

    def _sign_words(self) -> Iterator[str]:
        turned = [
            place for place, factor in zip(self.order, self.factors, strict=True) if factor < 0
        ]
        if len(turned) == len(self.order):
            yield "all joints seem to have the other sign"
        elif turned:
            names = ", ".join(f"q{place}" for place in sorted(turned))
            yield f"the sign of {names} seems to be turned"

    def _zero_words(self, axes: Sequence[Axis]) -> Iterator[str]:
        if self.zeros.any():
            listed = ", ".join(
                axis.text(zero, "+.4g")
                for axis, zero in zip(axes, self.zeros.tolist(), strict=True)
            )
            yield f"the joints seem to count from another zero ({listed})"

    def _remedy(self, axes: Sequence[Axis]) -> str:
        """Return the line to type: the columns' right header, or what to write in them."""
        columns = [axis.column for axis in axes]
        fed = [columns[place] for place in self.order]
        if not self.zeros.any():
            if (self.factors == 1.0).all():
                header = ",".join(columns[self.order.index(place)] for place in range(len(axes)))
                return f"correct the header of the joints: {header}"
            size = np.where([axis.is_revolute for axis in axes], math.degrees(1.0), 1.0)
            if fed == columns and (self.factors == size).all():
                return "give the joints in degrees"
            if fed == columns and len({*self.factors.tolist()}) == 1 and self.factors[0] != -1.0:
                factor = float(self.factors[0])
                verb, by = ("divide", 1.0 / factor) if abs(factor) < 1.0 else ("multiply", factor)
                return f"{verb} {', '.join(columns)} by {by:.6g}"
        written = [
            (_expression(axis, column, factor, zero), axis.column)
            for axis, column, factor, zero in zip(
                axes, fed, self.factors.tolist(), self.zeros.tolist(), strict=True
            )
        ]
        changed = [(text, column) for text, column in written if text != column]
        texts, columns = ([*part] for part in zip(*changed, strict=True))
        return f"write {', '.join(texts)} as {', '.join(columns)}"


def _expression(axis: Axis, column: str, factor: float, zero: float) -> str:
    times = {1.0: "", -1.0: "-"}.get(factor, f"{factor:.6g} * ")
    plus = f" {'-' if zero < 0.0 else '+'} {abs(axis.to_file(zero)):.4g}" if zero else ""
    return f"{times}{column}{plus}"


def order_words(order: tuple[int, ...]) -> Iterator[str]:
    """Yield in which order the joints stand, unless it is the right one."""
    if order != tuple(range(len(order))):
        yield f"the joints seem to stand in the order {', '.join(f'q{q}' for q in order)}"


# Six joints have 720 orders, which take half a minute to try. People swap two columns, or number
# the joints from another one on or the other way around: 26 orders.
def _orders(axes: Sequence[Axis]) -> Iterator[tuple[int, ...]]:
    """Yield the orders in which joints may stand, as written first: all of up to four joints."""
    # a column's name has its unit, so that no one takes one kind of joint for the other
    as_written, kinds = tuple(range(len(axes))), [axis.kind for axis in axes]
    if len(axes) <= MOST_IN_ANY_ORDER:
        orders = [*permutations(as_written)]
    else:
        orders = [as_written]
        for first, second in combinations(as_written, 2):
            swapped = [*as_written]
            swapped[first], swapped[second] = second, first
            orders.append(tuple(swapped))
        for way in (as_written, as_written[::-1]):
            orders += [way[begin:] + way[:begin] for begin in as_written]
    for order in dict.fromkeys(orders):
        if [kinds[place] for place in order] == kinds:
            yield order


def plain_maps(axes: Sequence[Axis]) -> Iterator[JointMap]:
    """Yield the maps in other orders, of other signs or from radians, as written first."""
    # In another order all signs are alike or one is turned: every sign in every order would
    # multiply the maps, 384 instead of 154 for four joints.
    # Joints given in radians were read as degrees and are too small by 180/π.
    count = len(axes)
    turns = np.array([axis.is_revolute for axis in axes])
    units = [np.ones(count), np.where(turns, math.degrees(1.0), 1.0)]
    few = [np.ones(count), -np.ones(count), *(1.0 - 2.0 * np.eye(count))]
    every = [np.array(signs) for signs in product((1.0, -1.0), repeat=count)]
    for place, order in enumerate(_orders(axes)):
        for unit, signs in product(units if turns.any() else units[:1], few if place else every):
            yield JointMap(order, unit * signs, np.zeros(count))


def simplest_map(
    nominal: Kinematics, columns: Array, points: Array, right_misfit: Callable[[Array], float]
) -> JointMap | None:
    """Return the simplest map that explains columns (N, n) and points (N, 3); None if none does.

    `right_misfit` returns the misfit of shots that were read rightly, by joints (N, n). A map that
    leaves no more explains; a simpler one than the best may leave half of that, or else twice of
    what the best does: more parameters explain the robot's errors, too.
    """
    shots = _Shots(nominal, columns, points)
    all_of_each = (np.eye(2 * columns.shape[1]), np.zeros(2 * columns.shape[1]))
    whole: list[tuple[float, JointMap]] = []
    for start in shots.starts():
        # one that explains as much can only be the cause if it is nearer to what is written
        if not any(joint_map.distance <= start.distance for _, joint_map in whole):
            _, near = shots.refined(start, _common(start))
            misfit, joint_map = shots.refined(near, all_of_each, START_MISFIT)
            if misfit <= right_misfit(joint_map.joints(columns)):
                whole.append((misfit, joint_map))
    if not whole:
        return None
    best = min(whole, key=lambda fitted: fitted[0])
    right = right_misfit(best[1].joints(columns))
    alike = min(right, max(right / 2.0, 2.0 * best[0]))
    # of other orders and signs that explain as much, as those of symmetrical robots do, the one
    # nearest to what is written
    _, joint_map = min(
        (fitted for fitted in whole if fitted[0] <= alike),
        key=lambda fitted: (fitted[1].distance, np.abs(fitted[1].zeros).sum()),
    )
    axes = nominal.mechanism.joints
    for kind in _simpler(joint_map, axes):
        misfit, simpler = shots.refined(joint_map, kind, START_MISFIT)
        if misfit <= alike:
            return simpler
    return joint_map


_Kind = tuple[Array, Array]
"""Basis (2n, k) and origin (2n,) of maps of one kind: factors, then zeros of n joints."""


def _common(start: JointMap) -> _Kind:
    """Return the maps near a start of which all joints that differ have one scale and one shift."""
    differs = (np.abs(start.factors) != 1.0) | (start.zeros != 0.0)
    scaled, shifted = np.where(differs, start.factors, 0.0), np.where(differs, 1.0, 0.0)
    basis = scipy.linalg.block_diag(scaled, shifted).T
    return basis, np.r_[start.factors - scaled, start.zeros]


def _simpler(whole: JointMap, axes: Sequence[Axis]) -> Iterator[_Kind]:
    """Yield the kinds of maps of the order and signs of a map, the simplest first."""
    count = len(axes)
    signs, nothing = np.sign(whole.factors), np.zeros((count, count))
    factor, factors = np.r_[signs, np.zeros(count)][:, None], np.r_[np.eye(count), nothing]
    zero, zeros = np.r_[np.zeros(count), np.ones(count)][:, None], np.r_[nothing, np.eye(count)]
    written = np.r_[signs, np.zeros(count)]
    turns = np.array([axis.is_revolute for axis in axes])
    radians = np.r_[np.where(turns, np.degrees(signs), signs), np.zeros(count)]
    units = [written, *([radians] if turns.any() else [])]
    for basis in (np.zeros((2 * count, 0)), zero):
        yield from ((basis, unit) for unit in units)
    yield factor, 0.0 * written
    for place in range(count):
        yield zeros[:, [place]], written
    for basis in (factors, np.c_[factors, zeros]):  # of one joint
        for place in range(count):
            of_joint = np.arange(basis.shape[1]) % count == place
            others = np.where(np.arange(2 * count) % count == place, 0.0, written)
            yield basis[:, of_joint], others
    yield from ((zeros, unit) for unit in units)
    for basis in (np.c_[factor, zero], np.c_[factor, zeros], factors):
        yield basis, 0.0 * written


@dataclass(frozen=True, slots=True, eq=False)
class _Shots:
    """Columns (N, n) of joints, and the points (N, 3) that the nominal robot should have there."""

    nominal: Kinematics
    columns: Array
    points: Array

    def starts(self) -> list[JointMap]:
        """Return the maps of the grid that fit best, each of another order and other signs."""
        # 1. A few shots sort out all but the best map of each order and signs.
        # 2. All shots sort these.
        grid = [*self._grid(), *self._grid_of_one()]
        few_rows = np.unique(
            np.linspace(0, len(self.columns) - 1, SHOTS_OF_THE_GRID).astype(np.intp)
        )
        coarse = self._misfits(grid, few_rows)
        best: dict[tuple[object, ...], JointMap] = {}
        for place in np.argsort(coarse, kind="stable").tolist():
            signs = tuple(np.sign(grid[place].factors).tolist())
            best.setdefault((*grid[place].order, *signs), grid[place])
        few = [*best.values()]
        fine = self._misfits(few, np.arange(len(self.columns)))
        # of maps that fit alike, as those of upright rails do, that of the least zeros is first
        zeros = np.array([np.linalg.norm(joint_map.zeros) for joint_map in few])
        return [few[place] for place in np.lexsort((zeros, fine.round(2)))[:STARTS].tolist()]

    def refined(
        self, start: JointMap, kind: _Kind, most: float = math.inf
    ) -> tuple[float, JointMap]:
        """Return the map of a kind near another map that fits best, after its misfit.

        Where the start leaves more than a misfit of `most`, that is infinite.
        """
        basis, origin = kind
        near: Array = np.linalg.lstsq(basis, np.r_[start.factors, start.zeros] - origin)[0]

        def map_at(coordinates: Array) -> JointMap:
            return JointMap(start.order, *np.split(basis @ coordinates + origin, 2))

        def residuals(coordinates: Array) -> Array:
            return np.asarray(self._residuals([map_at(coordinates)]).ravel())

        def slopes(coordinates: Array) -> Array:
            steps: Array = 1e-6 * np.maximum(np.abs(coordinates), 1e-3)
            moved = [map_at(each) for each in coordinates + np.diag(steps)]
            at = self._residuals([map_at(coordinates), *moved]).reshape(1 + len(steps), -1)
            return np.asarray((at[1:] - at[0]).T / steps)

        if float(np.sqrt(np.mean(residuals(near) ** 2))) > most:
            return math.inf, map_at(near)
        if basis.shape[1]:
            near = scipy.optimize.least_squares(
                residuals, near, slopes, x_scale="jac", loss="soft_l1", f_scale=OUTLIER,
                max_nfev=MOST_STEPS,
            ).x  # fmt: skip
        fitted = map_at(near)
        solution = self.nominal.forward(fitted.joints(self.columns))
        if not solution.is_solved.all():
            return math.inf, fitted
        positions = self.nominal.points(solution.values)
        return similarity_fit(positions, self.points, scaled=False)[1], fitted

    def _grid(self) -> Iterator[JointMap]:
        """Yield maps all over: joints of one kind are alike, so have one mean and one spread."""
        axes = self.nominal.mechanism.joints
        turns = np.array([axis.is_revolute for axis in axes])
        few = [np.ones(len(axes)), -np.ones(len(axes))]
        every = [np.array(signs) for signs in product((1.0, -1.0), repeat=len(axes))]
        spread = np.empty(len(axes))
        for kind in {*turns.tolist()}:
            spread[turns == kind] = self.columns[:, turns == kind].std(axis=0).mean() or 1.0
        sizes = [np.ones(len(axes)), *(share * self._units() / spread for share in SPREADS)]
        for place, order in enumerate(_orders(axes)):
            for signs, size in product(few if place else every, sizes):
                mean = signs * size * self.columns[:, order].mean(axis=0)
                yield JointMap(order, signs * size, 0.0 * mean)
                for centre in np.outer(CENTRES, self._reach()):
                    yield JointMap(order, signs * size, centre - mean)

    def _grid_of_one(self) -> Iterator[JointMap]:
        """Yield maps that differ by one joint from the columns as they are written."""
        count = self.columns.shape[1]
        mean, spread = self.columns.mean(axis=0), self.columns.std(axis=0)
        for place, sign, share in product(range(count), (1.0, -1.0), SPREADS):
            factors, zeros = np.ones(count), np.zeros(count)
            factors[place] = sign * share * self._units()[place] / (spread[place] or 1.0)
            yield JointMap(tuple(range(count)), factors.copy(), zeros.copy())
            for centre in CENTRES * self._reach()[place]:
                zeros[place] = centre - factors[place] * mean[place]
                yield JointMap(tuple(range(count)), factors.copy(), zeros.copy())

    def _misfits(self, maps: Sequence[JointMap], rows: Index) -> Array:
        picked = _Shots(self.nominal, self.columns[rows], self.points[rows])
        return np.asarray(np.sqrt(np.mean(picked._residuals(maps) ** 2, axis=(1, 2))))

    def _residuals(self, maps: Sequence[JointMap]) -> Array:
        """Return the residuals (G, N, 3) of G maps, in parts of the points' spread.

        A shot that the robot cannot take counts as if it was in the middle of the others.
        """
        joints = np.array([joint_map.joints(self.columns) for joint_map in maps])
        solution = self.nominal.forward(joints.reshape(-1, joints.shape[2]))
        positions = self.nominal.points(solution.values).reshape(*joints.shape[:2], 3)
        is_solved = solution.is_solved.reshape(joints.shape[:2])[..., None]
        positions = np.where(is_solved, positions, 0.0)
        middle = positions.sum(axis=1) / np.maximum(is_solved.sum(axis=1), 1)
        a = np.where(is_solved, positions - middle[:, None], 0.0)
        b = away_from_mean(self.points)
        rotations, _ = best_rotation(a, b)
        return np.asarray((b - a @ rotations.swapaxes(1, 2)) / spread_mm(self.points))

    def _units(self) -> Array:
        """Return a joint's usual size (n,): 1 rad, or the points' spread."""
        axes = self.nominal.mechanism.joints
        return np.array([1.0 if axis.is_revolute else spread_mm(self.points) for axis in axes])

    def _reach(self) -> Array:
        """Return how far a joint may be from its zero (n,): half a turn, or what rails have."""
        turns = np.array([axis.is_revolute for axis in self.nominal.mechanism.joints])
        return np.asarray(np.where(turns, np.pi, REACH * self._units()))
