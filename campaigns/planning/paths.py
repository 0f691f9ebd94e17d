"""Paths between stops: judge whether a joint move is safe, and find a detour where it is not.

A robot that is commanded to joints moves them in proportion (a coordinated move). Two poses that
are both allowed may be joined by a way that is not, so each move is sampled:

1. The mechanism, every 5° of the joint that turns furthest: it can be assembled, keeps its limits
   of turn and swing, and stays clear of singularities.
2. In a restricted space, the plate: on the coordinated way, sampled so finely that it is nearly
   straight between samples, and on straight lines between points of the way as well. A move that is
   commanded by pose may become any of these: which one is the controller's choice.
3. A robot may stand beyond a limit or wall: parameters that were loaded place it elsewhere than
   those before, or somebody has jogged it. So no margin of a move may be smaller than the limit or
   the margin where the move begins, whichever is less: it can leave, but go no further.
4. A move that is not safe is replaced by a detour: through one pose or several between its ends and
   the workspace's centre, few poses first. The first that is safe throughout is taken.

What comes out is a list of joint targets, or the reason and place of the first fault.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from campaigns.arrays import Array, Index, Mask
from campaigns.design.restricted_space import UNRESTRICTED, RestrictedSpace
from campaigns.design.tours import travel_rad
from campaigns.kinematics.axes import outside
from campaigns.kinematics.feasibility import Limits, Violation, path_feasibility
from campaigns.kinematics.model import Kinematics

Joints = tuple[float, ...]
Stop = tuple[str, Array]
"""Name of a place on the way for the operator, and its joints (n,)."""
PathFault = tuple[str, float]
"""Reason why a joint move is not safe, and the part of the way, 0 to 1, at which it occurs."""

PATH_STEP_RAD = np.radians(5.0)
"""Largest turn of a joint between samples at which the mechanism is judged."""
ROUNDING_RAD = 1e-6
"""Excess over a limit of turn, or of what compares, that rounded joints in files may cause."""
SPACE_STEP_RAD = np.radians(1.0)
"""Largest turn of a joint between the first samples at which the plate is judged."""
PARTS = (1, 2, 4, 8, 16)
"""Numbers of straight parts of equal turn into which a controller may divide a way."""
FLAT_MM = 0.005
"""Largest distance of the way from its chords: steps are halved until it is less."""
HALVINGS = 6
"""Largest number of step lengths that are tried; the last is taken however curved the way is."""
CURVATURE_RESERVE = 2.0
"""Largest curvature between samples, over the curvature that the samples around have."""
TOLERANCE_MM = 0.01
"""Distance beyond a wall that is ignored: poses may lie on the wall itself."""
MOVES_AT_ONCE = 500
"""Number of joint moves that are judged together: it bounds the memory."""
POINTS_AT_ONCE = 20_000
"""Number of points on moves in a restricted space that are judged together."""

UNASSEMBLED = "the mechanism cannot be assembled"
REASONS = {
    Violation.OUT_OF_REACH: UNASSEMBLED,
    Violation.TASK_LIMIT: "{limited} leaves its limits",
    Violation.SWING_LIMIT: "a forearm swings too far",
    Violation.SINGULAR: "it passes near a singularity",
    Violation.ABOVE_ELBOWS: "the platform rises above its arms' ends",
}
"""Words for each violation of a passed pose, the one that is reported first at the top. Joint
limits are not among them: between two values within an interval a joint stays within it."""
PASSING_VIOLATIONS = sum(REASONS)
STRAIGHT_PARTS = (4, 8, 16)
"""Numbers of parts of the straight lines between two poses and the centre: tried last."""


@dataclass(frozen=True, slots=True, eq=False)
class _SampledMoves:
    """Moves with equal numbers of steps, and points on their coordinated ways."""

    moves: Index
    """Rows (G,) of the moves among those that are judged."""
    points_mm: Array
    """Points of the plate at both ends of each step, (G, K + 1, 3)."""
    bulge_mm: Array
    """Largest distance of the way from the chord of each step, (G, K)."""


@dataclass(frozen=True, eq=False)
class RobotModel:
    """Robot and space that ways are checked against; joints are (n,)."""

    kinematics: Kinematics
    limits: Limits
    centre: Array
    """A pose well inside the workspace, where detours may lead, (t,)."""
    space: RestrictedSpace = UNRESTRICTED

    def fault(self, start: Array, end: Array) -> PathFault | None:
        """Return the first fault on the coordinated move between joints, if any."""
        return self.faults(start[None], end[None])[0]

    def faults(self, starts: Array, ends: Array) -> list[PathFault | None]:
        """Return the first fault of each coordinated move (M, n), or None where it is safe."""
        # The space is judged only on moves that the mechanism can make: it costs far more samples.
        faults: list[PathFault | None] = []
        for first in range(0, len(starts), MOVES_AT_ONCE):
            moves = slice(first, first + MOVES_AT_ONCE)
            faults += self._motion_faults(starts[moves], ends[moves])
        if self.space.is_restricted:
            clear = [move for move, fault in enumerate(faults) if fault is None]
            for move, fault in zip(
                clear, self._space_faults(starts[clear], ends[clear]), strict=True
            ):
                faults[move] = fault
        return faults

    def are_safe(self, ways: Array) -> Mask:
        """Return which of M ways of joint targets (L + 1, M, n) are safe, (M,)."""
        joints = ways.shape[2]
        faults = self.faults(ways[:-1].reshape(-1, joints), ways[1:].reshape(-1, joints))
        safe = np.array([fault is None for fault in faults], dtype=np.bool_)
        return np.asarray(safe.reshape(len(ways) - 1, -1).all(axis=0))

    def standing_fault(self, joints: Joints) -> str:
        """Return the zone in which the plate stands at joints, in words; empty: none."""
        solution = self.kinematics.forward(np.array([joints]))
        if not solution.is_solved[0]:
            return ""
        return self.space.fault(solution.values[0, :3])

    def legs(self, here: Joints, there: Joints) -> list[Joints] | None:
        """Return joint targets of a safe way, `there` itself the last; None if none was found."""
        return self.legs_of([(here, there)])[0]

    def legs_of(self, moves: Sequence[tuple[Joints, Joints]]) -> list[list[Joints] | None]:
        """Return joint targets of a safe way of each move, as `legs`."""
        starts, ends = (np.array([move[end] for move in moves]) for end in (0, 1))
        return [
            None if way is None else [*(tuple(leg.tolist()) for leg in way[:-1]), there]
            for way, (_, there) in zip(self.safe_ways(starts, ends), moves, strict=True)
        ]

    def safe_paths(self, stops: Array) -> list[list[Array] | None]:
        """Return joint targets of a safe way from each stop (K, n) to the next, as `safe_ways`."""
        return self.safe_ways(stops[:-1], stops[1:])

    def safe_ways(self, starts: Array, ends: Array) -> list[list[Array] | None]:
        """Return joint targets of a safe way from each start (M, n) to its end, the last.

        None stands where none was found. A way is straight if that is safe, else by poses between
        the ends and the workspace's centre.
        """
        if not len(starts):
            return []
        # 1. Straight moves, which most are: all of them in one batch.
        safe = self.are_safe(np.stack([starts, ends]))
        paths = [[end] if is_safe else None for end, is_safe in zip(ends, safe, strict=True)]
        if safe.all():
            return paths
        # 2. Detours lead by poses, so both ends need one. Each kind of detour is tried in one batch
        #    for all moves that are still blocked.
        first, last = (self.kinematics.forward(joints) for joints in (starts, ends))
        blocked = np.flatnonzero(~safe & first.is_solved & last.is_solved)
        for via in _detours(first.values, last.values, self.centre):
            if not blocked.size:
                break
            ways, safe = self._ways_by(starts[blocked], via[:, blocked], ends[blocked])
            for place in np.flatnonzero(safe):
                paths[blocked[place]] = list(ways[1:, place])
            blocked = blocked[~safe]
        return paths

    def _ways_by(self, starts: Array, via: Array, ends: Array) -> tuple[Array, Mask]:
        """Return the ways (K + 2, M, n) by poses (K, M, t), and which of them are safe."""
        # Poses of a detour may be out of reach, or their joints beyond limits, which samples do not
        # judge: only ways whose every pose can be taken are sampled.
        solution = self.kinematics.inverse(via.reshape(-1, via.shape[-1]))
        within = solution.is_solved & ~outside(solution.values, self.limits.joint).any(axis=1)
        safe: Mask = np.asarray(within.reshape(via.shape[:2]).all(axis=0))
        joints = solution.values.reshape(*via.shape[:2], -1)
        ways = np.concatenate([starts[None], joints, ends[None]])
        safe[safe] = self.are_safe(ways[:, safe])
        return ways, safe

    def _motion_faults(self, starts: Array, ends: Array) -> list[PathFault | None]:
        """Return the first fault of each move (M, n) by the mechanism and its limits."""
        task = zip(self.kinematics.mechanism.task, self.limits.task, strict=True)
        limited = ", ".join(axis.name for axis, limit in task if limit)
        # 1. Judge all samples of all moves together; those that cannot be assembled have no pose,
        #    and a move with such a sample is faulty, whatever the others are.
        move, part = self._samples(starts, ends)
        joints = starts[move] + part[:, None] * (ends - starts)[move]
        solution = self.kinematics.forward(joints)
        solved, place = solution.is_solved, np.cumsum(solution.is_solved) - 1
        begins = place[np.searchsorted(move, move)]
        violations = np.full(len(joints), int(Violation.OUT_OF_REACH))
        violations[solved] = self._passing_violations(
            joints[solved], solution.values[solved], begins[solved]
        )
        # 2. Of each faulty move take the gravest violation anywhere on it, where it begins.
        faults: list[PathFault | None] = [None] * len(starts)
        for faulty in np.unique(move[violations != 0]).tolist():
            rows = np.flatnonzero(move == faulty)
            violation = next(reason for reason in REASONS if (violations[rows] & reason).any())
            first = rows[np.argmax((violations[rows] & violation) != 0)]
            faults[faulty] = REASONS[violation].format(limited=limited), float(part[first])
        return faults

    def _samples(self, starts: Array, ends: Array) -> tuple[Index, Array]:
        """Sample moves (M, n): return each sample's move and its part of the way, (S,)."""
        turn = np.abs(self.kinematics.comparable(ends - starts)).max(axis=1)
        # both ends are always samples, also of a move that goes nowhere
        counts = np.maximum(2, np.ceil(turn / PATH_STEP_RAD).astype(np.intp) + 1)
        move = np.repeat(np.arange(len(counts)), counts)
        part = np.concatenate([np.linspace(0.0, 1.0, count) for count in counts])
        return move, part

    def _passing_violations(self, joints: Array, poses: Array, starts: Index) -> Index:
        """Return the violations (N,) at poses (N, t) of ways that begin at rows `starts` (N,)."""
        rounding = [-ROUNDING_RAD * axis.scale for axis in self.kinematics.mechanism.task]
        limits = self.limits.narrowed_by(task=rounding, swing_rad=-ROUNDING_RAD)
        kinematics = self.kinematics
        mechanism, p = kinematics.mechanism, kinematics.p
        passed = path_feasibility(mechanism, p, limits, (joints, poses), starts)
        return passed.violations & PASSING_VIOLATIONS

    def _space_faults(self, starts: Array, ends: Array) -> list[PathFault | None]:
        """Return the zone entered on each move (M, n), or on straight lines it may become."""
        # A move that `_fine_paths` does not yield cannot be assembled somewhere: its fault remains.
        faults: list[PathFault | None] = [(UNASSEMBLED, 0.0)] * len(starts)
        for sampled in self._fine_paths(starts, ends):
            clearance_mm = self._clearance_mm(sampled)
            entered = clearance_mm < self._least_clearance_mm(sampled)[:, None]
            steps = sampled.bulge_mm.shape[1]
            for row, move in enumerate(sampled.moves.tolist()):
                faults[move] = self._first_zone(clearance_mm[row], entered[row], steps)
        return faults

    def _clearance_mm(self, sampled: _SampledMoves) -> Array:
        """Return the clearance of each line of moves from each zone, (G, L, Z).

        Lines are the K chords of the way itself, then its 1, 2, 4, 8 and 16 straight parts.
        """
        points, steps = sampled.points_mm, sampled.bulge_mm.shape[1]
        polylines = [points, *(points[:, :: steps // parts] for parts in PARTS)]
        line_starts = np.concatenate([line[:, :-1] for line in polylines], axis=1)
        line_ends = np.concatenate([line[:, 1:] for line in polylines], axis=1)
        clearance_mm = self.space.line_clearance_mm(
            line_starts.reshape(-1, 3), line_ends.reshape(-1, 3)
        ).reshape(*line_starts.shape[:2], -1)
        # The way may bulge beyond its chords, and has that much less; parts are exactly straight.
        clearance_mm[:, :steps] -= sampled.bulge_mm[:, :, None]
        return clearance_mm

    def _least_clearance_mm(self, sampled: _SampledMoves) -> Array:
        """Return the clearance from each zone that moves need, (G, Z)."""
        starts_mm = self.space.clearance_mm(sampled.points_mm[:, 0])
        return np.asarray(np.minimum(starts_mm, 0.0) - TOLERANCE_MM)

    def _first_zone(self, clearance_mm: Array, entered: Mask, steps: int) -> PathFault | None:
        """Return the first zone entered on lines (L, Z) of a move, its own steps first."""
        # Only the move's own `steps` lines have a place on the way; of a straight part it is 0.
        if not entered.any():
            return None
        row = int(np.argmax(entered.any(axis=1)))
        zone = int(np.argmin(np.where(entered[row], clearance_mm[row], np.inf)))
        reason = (
            f"the plate{self.space.reach_text} would pass {-clearance_mm[row, zone]:.3g} mm beyond "
            f"the wall of {self.space.zones[zone].name}"
        )
        return reason, row / steps if row < steps else 0.0

    def _fine_paths(self, starts: Array, ends: Array) -> Iterator[_SampledMoves]:
        """Yield coordinated moves (M, n), sampled so finely that they are nearly straight.

        Moves with equal numbers of steps come together. Moves on which the mechanism cannot be
        assembled are left out.
        """
        # Steps are a multiple of 16, so that all of `PARTS` divide them.
        turn = np.abs(self.kinematics.comparable(ends - starts)).max(axis=1)
        steps = PARTS[-1] * np.maximum(1, np.ceil(turn / SPACE_STEP_RAD / PARTS[-1])).astype(int)
        open_moves, first_steps = np.arange(len(steps)), steps.copy()
        while open_moves.size:
            # 1. Take the moves with fewest steps, so that all have points of one shape.
            count = int(steps[open_moves].min())
            group = open_moves[steps[open_moves] == count]
            group = group[: max(1, POINTS_AT_ONCE // (count + 1))]
            points_mm, is_assembled = self._points_on(starts[group], ends[group], count)
            bulge_mm = _bulge_mm(points_mm)
            # 2. Yield what is flat enough, or halved often enough: either way its bulge counts.
            is_last = count >= first_steps[group] * 2 ** (HALVINGS - 1)
            is_fine = is_assembled & (is_last | (bulge_mm.max(axis=1) <= FLAT_MM))
            if is_fine.any():
                yield _SampledMoves(group[is_fine], points_mm[is_fine], bulge_mm[is_fine])
            # 3. Halve the steps of the others, and drop moves that cannot be assembled.
            steps[group[~is_fine]] *= 2
            open_moves = np.setdiff1d(open_moves, group[is_fine | ~is_assembled])

    def _points_on(self, starts: Array, ends: Array, steps: int) -> tuple[Array, Mask]:
        """Return points (G, K + 1, 3) on moves (G, n) in K steps, and which can be assembled."""
        part = np.linspace(0.0, 1.0, steps + 1)[:, None]
        joints = starts[:, None] + part * (ends - starts)[:, None]
        solution = self.kinematics.forward(joints.reshape(-1, joints.shape[-1]))
        is_assembled = np.asarray(solution.is_solved.reshape(len(starts), -1).all(axis=1))
        return solution.values[:, :3].reshape(len(starts), -1, 3), is_assembled


# A curve with second derivative c is at most c h² / 8 away from a chord over a step h, and c h² is
# the second difference of points. Each chord takes the larger one of its two ends.
def _bulge_mm(points_mm: Array) -> Array:
    """Return how far ways through points (G, K + 1, 3) may be from each of their chords, (G, K)."""
    second = np.linalg.norm(np.diff(points_mm, 2, axis=1), axis=2)
    at_start = np.concatenate([second[:, :1], second], axis=1)
    at_end = np.concatenate([second, second[:, -1:]], axis=1)
    bulge_mm: Array = CURVATURE_RESERVE * np.maximum(at_start, at_end) / 8.0
    return bulge_mm


def _detours(starts: Array, ends: Array, centre: Array) -> list[Array]:
    """List poses (K, …, t) to pass by between poses (…, t), one list a detour, few poses first."""
    # 1. By one pose: the middle of both, drawn more and more towards the centre.
    # 2. By both ends drawn towards the centre, without and with the centre itself between them.
    # 3. By many poses on straight lines, to the other end or by the centre: in short legs the
    #    coordinated move keeps near the straight line, which it may leave far behind otherwise.
    middle, centres = 0.5 * (starts + ends), np.broadcast_to(centre, starts.shape)
    detours = [(middle + pull * (centre - middle))[None] for pull in (0.0, 0.3, 0.6, 1.0)]
    for pull in (0.3, 0.6):
        first, last = (end + pull * (centre - end) for end in (starts, ends))
        detours += [np.stack([first, last]), np.stack([first, centres, last])]
    for parts in STRAIGHT_PARTS:
        detours.append(np.linspace(starts, ends, parts + 1)[1:-1])
        inwards = np.linspace(starts, centres, parts + 1)[1:]
        detours.append(np.concatenate([inwards, np.linspace(centres, ends, parts + 1)[1:-1]]))
    return detours


@dataclass(frozen=True, slots=True)
class PathReport:
    """Ways between the stops of a plan."""

    detours: int
    """Number of ways that are not straight because that would not be safe."""
    travel_rad: float
    """Sum over all legs of the largest joint's way, of cranks or what compares."""
    faults: tuple[str, ...]
    """Line for each two consecutive stops without a safe way, with the straight move's fault."""


def check_paths(stops: Sequence[Stop], robot: RobotModel) -> PathReport:
    """Find a safe way between each two stops that follow each other; report those without."""
    ways = robot.safe_paths(np.array([joints for _, joints in stops]))
    detours, travel = 0, 0.0
    faults: list[str] = []
    for (here, there), way in zip(pairwise(stops), ways, strict=True):
        if way is None:
            straight = robot.fault(here[1], there[1])
            why = f"{straight[0]}, {straight[1]:.0%} of the way" if straight else "blocked"
            faults.append(f"no safe way from {here[0]} to {there[0]}: {why}, and no way round")
            continue
        detours += len(way) > 1
        turns = robot.kinematics.comparable(np.stack([here[1], *way]))
        travel += float(travel_rad(turns[:-1], turns[1:]).sum())
    return PathReport(detours, travel, tuple(faults))
