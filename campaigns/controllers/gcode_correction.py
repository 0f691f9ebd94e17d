"""Corrected G-code: moves split until what is commanded follows the wanted path."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.controllers.corrected_targets import CorrectedFile, TargetCorrection, correction_mm
from campaigns.controllers.gcode import Block, parse_gcode
from campaigns.controllers.gcode_moves import (
    AXIS_LETTERS,
    MOTIONS,
    ROTARY,
    Move,
    axis_letters,
    moves_of,
)
from campaigns.errors import TargetsInvalid
from campaigns.files.csv_file import fixed_text
from campaigns.mechanisms.mechanism import Axis

TOLERANCE_MM = 0.01
LEVER_MM = 100.0
"""Length that turns a turn's error into one of place."""
PROBES = 4
"""Parts of a piece at whose ends a path is compared with its chord."""
COARSE = 8
"""Parts of a whole move, at whose ends it is looked at before it is split."""
ROUNDS = 30
MOST_PIECES = 300_000
"""Of a program: 20 s and 400 MB. Of few moves so many would be a tolerance below what the numbers
in a file can say."""
CHUNK = 20_000
LINES = 1000
"""Of a program that are looked at together: a long one needs no more memory than these and text."""
STD_POSES = 100
"""Poses of each such part at which σ is asked."""
DECIMALS = 4
STOPS = frozenset(("M0", "M1", "M2", "M30", "M60"))
"""Codes that a controller carries out after the motion of their line."""


@dataclass(frozen=True, slots=True, eq=False)
class _Paths:
    """Wanted paths of M moves."""

    start: Array
    """(M, t)"""
    way: Array
    """To the end, (M, t)."""
    centre: Array
    """Of arcs, (M, 2); NaN of straight moves."""
    sweep: Array
    """(M,)"""

    @classmethod
    def of(cls, moves: Sequence[Move]) -> "_Paths":
        """Paths of moves; those without a known start stay at their ends."""
        end = np.array([move.end for move in moves])
        start = np.array([move.start or move.end for move in moves])
        nowhere = (np.nan, np.nan)
        centre = np.array([move.centre_mm or nowhere for move in moves])
        sweep = np.array([move.sweep_rad for move in moves])
        return cls(start, end - start, centre, sweep)

    def at(self, rows: Index, part: Array) -> Array:
        """Poses (K, t) at parts of the ways (K,) of the moves `rows` (K,)."""
        poses = self.start[rows] + part[:, None] * self.way[rows]
        arcs = np.isfinite(self.centre[rows, 0])
        own, along = rows[arcs], part[arcs]
        first = self.start[own, :2] - self.centre[own]
        last = first + self.way[own, :2]
        radius = (1.0 - along) * np.hypot(*first.T) + along * np.hypot(*last.T)
        angle = np.arctan2(first[:, 1], first[:, 0]) + along * self.sweep[own]
        around = radius[:, None] * np.column_stack([np.cos(angle), np.sin(angle)])
        poses[arcs, :2] = self.centre[own] + around
        return poses


def correct_gcode(
    text: str,
    name: str,
    correction: TargetCorrection,
    *,
    tolerance_mm: float = TOLERANCE_MM,
    rotary: str = ROTARY,
) -> CorrectedFile:
    """Correct a program; raises `TargetsInvalid` naming the line that cannot be corrected."""
    task = correction.identified.mechanism.task
    program = moves_of(parse_gcode(text, name), name, task, rotary)
    letters, usual, most = axis_letters(task, rotary), "", MOST_PIECES
    written: list[str] = []
    sizes: list[Array] = []
    stds: list[float] = []
    moves, before = 0, None
    while lines := tuple(islice(program, LINES)):
        first = lines[0]
        usual = usual or (first.block if isinstance(first, Move) else first).ending or "\n"
        some = [line for line in lines if isinstance(line, Move)]
        ends: list[Array] = []
        if some:
            wanted, pieces = _wanted(some, name, correction, tolerance_mm, most)
            sides = correction.approach(wanted, before)
            before = wanted[-1], sides[-1]
            commanded = _commanded(correction, wanted, sides)
            ends = np.split(commanded, np.cumsum(pieces)[:-1])
            sizes.append(correction_mm(wanted, commanded))
            stds += _some_std(correction, wanted)
            moves, most = moves + len(some), most - len(wanted)
        written.append("".join(_written(lines, ends, letters, task, usual)))
    if not moves:
        raise TargetsInvalid(f"{name}: moves nothing", remedy="check that it is the right file")
    return CorrectedFile.of("".join(written), moves, np.concatenate(sizes), np.array(stds))


def _wanted(
    moves: Sequence[Move], name: str, correction: TargetCorrection, tolerance_mm: float, most: int
) -> tuple[Array, Index]:
    """Wanted poses (K, t) at the ends of all pieces, and how many of them each move has, (M,)."""
    paths = _Paths.of(moves)
    numbers = np.array([move.block.number for move in moves])
    _require_possible(correction, paths, np.full(len(moves), COARSE), numbers, name)
    pieces = _pieces(correction, paths, tolerance_mm, most)
    _require_possible(correction, paths, PROBES * pieces, numbers, name)
    return paths.at(*_ends(pieces)), pieces


def _pieces(correction: TargetCorrection, paths: _Paths, tolerance_mm: float, most: int) -> Index:
    """Number of straight pieces (M,) that each path needs, `most` in all."""
    pieces = np.ones(len(paths.start), dtype=np.intp)
    left = np.flatnonzero(np.isfinite(paths.centre[:, 0]) | (paths.way != 0.0).any(axis=1))
    for _ in range(ROUNDS if pieces.sum() <= most else 0):
        error = _chord_errors_mm(correction, paths, left, pieces[left])
        wrong = error > tolerance_mm
        left, error = left[wrong], error[wrong]
        if not left.size:
            return pieces
        more = np.ceil(1.02 * pieces[left] * np.sqrt(error / tolerance_mm)).astype(np.intp)
        pieces[left] = np.maximum(pieces[left] + 1, more)
        if pieces.sum() > most:
            break
    raise TargetsInvalid(
        f"the moves would need more than {MOST_PIECES} pieces for --tolerance {tolerance_mm:g} mm",
        remedy="give a larger --tolerance, or split the program",
    )


def _chord_errors_mm(
    correction: TargetCorrection, paths: _Paths, rows: Index, pieces: Index
) -> Array:
    """Largest distance of what should be commanded from the chords of each path's pieces, (K,)."""
    if not rows.size:
        return np.empty(0)
    each, part = _probes(PROBES * pieces)
    commanded = _commanded(correction, paths.at(rows[each], part))
    first = np.concatenate([[0], np.cumsum(PROBES * pieces + 1)[:-1]])
    place = np.arange(len(each)) - first[each]
    low = first[each] + PROBES * np.minimum(place // PROBES, pieces[each] - 1)
    share = ((place - (low - first[each])) / PROBES)[:, None]
    chord = (1.0 - share) * commanded[low] + share * commanded[low + PROBES]
    away = commanded - chord
    levers = [LEVER_MM if axis.is_revolute else 1.0 for axis in correction.nominal.mechanism.task]
    # a place that cannot be taken is said when all of them are looked at
    error = np.nan_to_num(np.linalg.norm(away * levers, axis=1), nan=0.0)
    return np.asarray(np.maximum.reduceat(error, first))


def _probes(parts: Index) -> tuple[Index, Array]:
    """Rows (K,) and parts of the way (K,) of the ends of so many equal parts of each path."""
    rows = np.repeat(np.arange(len(parts)), parts + 1)
    first = np.concatenate([[0], np.cumsum(parts + 1)[:-1]])
    return rows, (np.arange(len(rows)) - first[rows]) / parts[rows]


def _ends(pieces: Index) -> tuple[Index, Array]:
    """Rows and parts of the way of the ends of all pieces, without each path's start."""
    rows, part = _probes(pieces)
    later = part > 0.0
    return rows[later], part[later]


def _require_possible(
    correction: TargetCorrection, paths: _Paths, parts: Index, lines: Index, name: str
) -> None:
    """Raise `TargetsInvalid` for the first place on a path that the robot must not be sent to."""
    rows, part = _probes(parts)
    for begin in range(0, len(rows), CHUNK):
        some = rows[begin : begin + CHUNK]
        wanted = paths.at(some, part[begin : begin + CHUNK])

        def place(row: int, some: Index = some, wanted: Array = wanted) -> str:
            x, y, z = wanted[row, :3].tolist()
            return f"{name}:{lines[some[row]]}: at X{x:.3f} Y{y:.3f} Z{z:.3f}"

        correction.require_possible(wanted, place, "move")


def _commanded(correction: TargetCorrection, wanted: Array, approach: Array | None = None) -> Array:
    """Poses (N, t) to command, NaN where there is none.

    Without `approach` no backlash counts: a reversal is a step that no shorter piece makes smaller.
    """
    parts = (slice(at, at + CHUNK) for at in range(0, len(wanted), CHUNK))
    found = [
        correction.commanded(wanted[rows], None if approach is None else approach[rows]).values
        for rows in parts
    ]
    return np.concatenate(found)


def _some_std(correction: TargetCorrection, wanted: Array) -> list[float]:
    """σ of a position, mm, at some of the poses, evenly taken; none where it is not known."""
    if correction.uncertainty is None:
        return []
    return list(map(float, correction.std_mm(wanted[:: max(1, len(wanted) // STD_POSES)])))


def _written(
    lines: Sequence[Move | Block],
    ends: Sequence[Array],
    letters: Sequence[str],
    task: Sequence[Axis],
    usual: str,
) -> Iterator[str]:
    """Lines of the corrected program, each with its ending."""
    poses_of = iter(ends)
    for line in lines:
        if isinstance(line, Block):
            yield line.text
            continue
        places = [
            [
                f"{a}{fixed_text(t.to_file(v), DECIMALS)}"
                for a, t, v in zip(letters, task, pose, strict=True)
            ]
            for pose in next(poses_of).tolist()
        ]
        bodies = _bodies(line, places)
        yield from (body + usual for body in bodies[:-1])
        yield bodies[-1] + line.block.ending


def _bodies(move: Move, places: Sequence[list[str]]) -> list[str]:
    """Lines of one move: what stands beside it in the first, what comes after it in the last."""
    motion = "G0" if move.rapid else "G1"
    words = [
        word
        for word in move.block.words
        if word.letter not in AXIS_LETTERS and word.code not in MOTIONS
    ]
    if move.centre_mm is not None:
        words = [word for word in words if word.letter not in "IJP"]
    before = [word.text for word in words if word.letter in "NG"]
    repeated = [word.text for word in words if word.code == "G53"]
    beside = [word.text for word in words if word.letter not in "NG" and word.code not in STOPS]
    after = [word.text for word in words if word.code in STOPS]
    last = len(places) - 1
    bodies = []
    for number, place in enumerate(places):
        line = [*(before if number == 0 else repeated), motion, *place]
        line += beside if number == 0 else []
        line += after if number == last else []
        line += move.block.comments if number == 0 else []
        bodies.append(" ".join(line))
    return bodies
