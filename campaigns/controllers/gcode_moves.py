"""Moves of a G-code program: its modal state followed line by line.

What cannot be corrected is refused by its line: whatever makes coordinates mean something else than
a place in the base frame, and motions that are no straight line or arc in the XY plane.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

from campaigns.controllers.gcode import Block, Word
from campaigns.errors import TargetsInvalid
from campaigns.mechanisms.mechanism import Axis

ROTARY = "C"
"""Letter of the platform's turn in LinuxCNC's world coordinates XYZC."""
AXIS_LETTERS = "ABCUVWXYZE"
STRAIGHT = ("G0", "G1")
ARCS = ("G2", "G3")
MOTIONS = (*STRAIGHT, *ARCS, "G80")
PLANES = ("G17", "G18", "G19")
HOMES = ("G28", "G30")
DWELL = "G4"
_MODES = (
    "G17",
    "G18",
    "G19",
    "G21",
    "G40",
    "G49",
    "G50",
    "G69",
    "G80",
    "G90",
    "G91.1",
    "G94",
    "G97",
)
_SPEED_AND_PLACE = ("G53", "G54", "G61", "G61.1", "G64")
KEPT = frozenset((DWELL, *HOMES, *_MODES, *_SPEED_AND_PLACE))
"""Codes besides moves that leave coordinates places in the base frame, in mm."""
_NO_CYCLES = "let the CAM write cycles out as single moves"
_NO_OFFSETS = "write coordinates of the base frame, and keep the controller's offsets at zero"
REMEDIES: Mapping[str, str] = {
    "G20": "write the program in mm (G21)",
    "G91": "write absolute coordinates (G90)",
    "G90.1": "give the centres of arcs from their starts (G91.1)",
    **dict.fromkeys(("G10", "G52", "G92", "G92.1", "G92.2", "G92.3"), _NO_OFFSETS),
    **dict.fromkeys(("G55", "G56", "G57", "G58", "G59", "G59.1", "G59.2", "G59.3"), _NO_OFFSETS),
    **dict.fromkeys(("G41", "G41.1", "G42", "G42.1"), "let the CAM put the tool's radius in"),
    **dict.fromkeys(("G43", "G43.1", "G43.2"), "let the CAM put the tool's length into Z"),
    **dict.fromkeys(("G93", "G95"), "give feeds in mm/min (G94)"),
    **dict.fromkeys(
        ("G73", "G74", "G76", *(f"G{n}" for n in range(81, 90)), "G98", "G99"), _NO_CYCLES
    ),
    **dict.fromkeys(("G5", "G5.1", "G5.2", "G5.3"), "let the CAM write splines as straight moves"),
    **dict.fromkeys(("G51", "G68", "G16"), "let the CAM scale and turn the program"),
}
OTHER_REMEDY = "take it out, or write it as straight moves and arcs in absolute mm"
REFUSED_M = frozenset(("M70", "M71", "M72", "M73", "M97", "M98", "M99"))
"""They bring other modes back, or run other lines."""
RADIUS_TOLERANCE_MM = 0.01
FULL_TURN = 2.0 * math.pi
SAME_DIRECTION_RAD = 1e-9


@dataclass(frozen=True, slots=True)
class Move:
    """Motion of one line, in inner units of the task axes."""

    block: Block
    start: tuple[float, ...] | None
    """None: it is not known where the robot stands."""
    end: tuple[float, ...]
    rapid: bool
    centre_mm: tuple[float, float] | None = None
    """Of an arc in the XY plane, whose radius passes from one end's to the other's."""
    sweep_rad: float = 0.0
    """Of an arc, positive anticlockwise."""


def moves_of(
    blocks: Iterable[Block], name: str, task: Sequence[Axis], rotary: str = ROTARY
) -> Iterator[Move | Block]:
    """Each line's move, or the line where it is none; raises `TargetsInvalid` naming the line."""
    return _Program(name, axis_letters(task, rotary), tuple(task)).moves(blocks)


def axis_letters(task: Sequence[Axis], rotary: str = ROTARY) -> tuple[str, ...]:
    """Letters of the task axes: X, Y, Z and that of the turn."""
    return tuple(rotary if axis.is_revolute else axis.name.upper() for axis in task)


@dataclass
class _Program:
    """Modal state of a program, up to some line."""

    name: str
    letters: tuple[str, ...]
    task: tuple[Axis, ...]
    place: tuple[float, ...] | None = None
    motion: str | None = None
    plane: str = "G17"
    where: str = field(default="", init=False)

    def moves(self, blocks: Iterable[Block]) -> Iterator[Move | Block]:
        """Follow the lines."""
        for block in blocks:
            self.where = f"{self.name}:{block.number}"
            move = self._follow(block)
            if move is not None:
                self.place = move.end
            yield move or block

    def _follow(self, block: Block) -> Move | None:
        codes = block.codes("G")
        if block.may_be_skipped and (codes or self._axis_words(block)):
            raise self._refused(
                "a line that may be skipped (/) moves or changes modes",
                "take the slash or the line out",
            )
        self._check_codes(codes, block.codes("M"))
        motions = [code for code in codes if code in MOTIONS]
        if len(motions) > 1:
            raise self._refused(f"{' and '.join(motions)} in one line", "keep one of them")
        self.motion = motions[0] if motions else self.motion
        self.plane = next((code for code in codes if code in PLANES), self.plane)
        words = self._axis_words(block)
        special = next((code for code in codes if code in (*HOMES, DWELL)), None)
        if special:
            self._stay(special, words)
            return None
        if self.motion in ARCS and (words or {"I", "J"} & block.values().keys()):
            return self._arc(block)
        return self._straight(block) if words else None

    def _check_codes(self, codes: Sequence[str], machine: Sequence[str]) -> None:
        for code in codes:
            if code not in KEPT and code not in MOTIONS:
                raise self._refused(f"{code} cannot be corrected", REMEDIES.get(code, OTHER_REMEDY))
        for code in machine:
            if code in REFUSED_M:
                raise self._refused(
                    f"{code} brings other modes back or runs other lines", "write the program out"
                )

    def _axis_words(self, block: Block) -> tuple[Word, ...]:
        """Words of the robot's axes; refuses those of others."""
        words = tuple(word for word in block.words if word.letter in AXIS_LETTERS)
        for word in words:
            if word.letter not in self.letters:
                raise self._refused(
                    f"{word.text}: the robot's axes are {' '.join(self.letters)}",
                    "take the word out, or name the letter of the robot's turn with --rotary",
                )
        return words

    def _stay(self, code: str, words: Sequence[Word]) -> None:
        if words:
            raise self._refused(
                f"{code} with {words[0].text}",
                "give the coordinates in a line of their own, with G0 or G1",
            )
        if code in HOMES:
            self.place = None

    def _straight(self, block: Block) -> Move:
        if self.motion not in STRAIGHT:
            mode = f"after {self.motion}" if self.motion else "without a G0 or G1 before them"
            raise self._refused(f"coordinates {mode}", "write G0 or G1 before the coordinates")
        foreign = {"I", "J", "K", "R"} & block.values().keys()
        if foreign:
            raise self._refused(
                f"{min(foreign)} in a straight move", "take it out, or write G2 or G3"
            )
        return Move(block, self.place, self._end(block), rapid=self.motion == "G0")

    def _arc(self, block: Block) -> Move:
        values = block.values()
        self._check_arc(values)
        assert self.place is not None, "checked"
        end = self._end(block)
        offset = (values.get("I", 0.0), values.get("J", 0.0))
        centre = (self.place[0] + offset[0], self.place[1] + offset[1])
        radius = math.hypot(*offset)
        last = (end[0] - centre[0], end[1] - centre[1])
        if abs(math.hypot(*last) - radius) > RADIUS_TOLERANCE_MM or radius == 0.0:
            raise self._refused(
                f"the arc begins {radius:.4f} mm from its centre and ends "
                f"{math.hypot(*last):.4f} mm from it (limit {RADIUS_TOLERANCE_MM:g} mm apart)",
                "correct I and J, which count from the start",
            )
        turn = math.atan2(last[1], last[0]) - math.atan2(-offset[1], -offset[0])
        anticlockwise = self.motion == "G3"
        sweep = turn % FULL_TURN if anticlockwise else -(-turn % FULL_TURN)
        if FULL_TURN - abs(sweep) < SAME_DIRECTION_RAD or abs(sweep) < SAME_DIRECTION_RAD:
            sweep = FULL_TURN if anticlockwise else -FULL_TURN
        return Move(block, self.place, end, rapid=False, centre_mm=centre, sweep_rad=sweep)

    def _check_arc(self, values: Mapping[str, float]) -> None:
        if self.plane != "G17":
            raise self._refused(f"an arc in {self.plane}", "write arcs in the XY plane (G17)")
        if "R" in values:
            raise self._refused("an arc by its radius R", "give its centre by I and J")
        if "K" in values:
            raise self._refused("K in an arc in G17", "give its centre by I and J")
        if not {"I", "J"} & values.keys():
            raise self._refused("an arc without a centre", "give its centre by I and J")
        if values.get("P", 1.0) != 1.0:
            raise self._refused("an arc of several turns (P)", "write a line for each turn")
        if self.place is None:
            raise self._refused(
                "an arc, but it is not known where the robot stands",
                f"let a straight move give {' '.join(self.letters)} first",
            )

    def _end(self, block: Block) -> tuple[float, ...]:
        """Where a move ends: what it does not say stays."""
        values = block.values()
        missing = [letter for letter in self.letters if letter not in values]
        if self.place is None and missing:
            raise self._refused(
                f"it is not known where the robot stands, and the move gives no {missing[0]}",
                f"let the first move, and that after G28 or G30, give {' '.join(self.letters)}",
            )
        before = self.place or (0.0,) * len(self.letters)
        return tuple(
            axis.from_file(values[letter]) if letter in values else old
            for letter, axis, old in zip(self.letters, self.task, before, strict=True)
        )

    def _refused(self, problem: str, remedy: str) -> TargetsInvalid:
        return TargetsInvalid(f"{self.where}: {problem}", remedy=remedy)
