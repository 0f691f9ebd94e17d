"""Correct the straight moves of a G-code program for a controller with nominal parameters.

    python correct_gcode.py part.ngc robot-compensated.yaml robot.yaml > part-corrected.ngc

Corrected are G0 and G1 with absolute coordinates in mm and the turn C in deg, in the base frame.
Seen in the controller's coordinates a wanted line is curved, so each move is divided into steps.
Every other line stays as it is. A line that this program does not understand ends it: arcs, other
units, planes or frames, incremental coordinates, variables, subprograms.
"""

import math
import re
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pkmcal import TargetsInvalid, correct_targets, find_robot

STEP_MM, STEP_DEG = 5.0, 1.0
LETTERS = "XYZC"
COMMENT = re.compile(r"\([^()]*\)|;.*")
WORD = re.compile(r"\s*([A-Z])\s*([+-]?(?:\d+\.?\d*|\.\d+))")
MOTIONS = {"G0", "G1"}
HARMLESS = {"G4", "G17", "G21", "G54", "G61", "G64", "G90", "G94"}
HARMLESS |= {f"M{code}" for code in (*range(10), 30, 60)}


class NotUnderstood(Exception):
    """Line of a program that cannot be corrected."""


@dataclass(frozen=True)
class Line:
    """Line of a program: its text, and of a move its words and its end, mm and deg."""

    text: str
    motion: str = ""
    other_words: str = ""
    end: tuple[float, ...] = ()


def words_of(text: str) -> Iterator[tuple[str, float]]:
    """Yield the words of a line as letter and number; raise `NotUnderstood` for other text."""
    bare, place = COMMENT.sub("", text).strip().upper(), 0
    while place < len(bare):
        word = WORD.match(bare, place)
        if word is None:
            raise NotUnderstood(f"'{bare[place:]}' is no word of a letter and a number")
        yield word[1], float(word[2])
        place = word.end()


def parse_line(text: str, motion: str, here: dict[str, float], letters: str) -> Line:
    """Parse a line after `motion` and coordinates `here`, which it changes, or refuse it."""
    coordinates, other_words = dict[str, float](), list[str]()
    for letter, value in words_of(text):
        code = f"{letter}{value:g}"
        if letter in letters and letter not in coordinates:
            coordinates[letter] = value
        elif code in MOTIONS:
            motion = code
        elif code in HARMLESS or letter in "FSNPT":
            other_words.append(code)
        else:
            raise NotUnderstood(f"{code} is not followed")
    if not coordinates:
        return Line(text, motion)
    if beside := [code for code in other_words if code[0] == "M" or code == "G4"]:
        raise NotUnderstood(f"{beside[0]} beside a move, which may become several")
    if not motion:
        raise NotUnderstood("coordinates without G0 or G1 before them")
    here |= coordinates
    if missing := [letter for letter in letters if letter not in here]:
        raise NotUnderstood(f"the first move has no {missing[0]}")
    return Line(text, motion, " ".join(other_words), tuple(here[letter] for letter in letters))


def lines_of(program: str, letters: str) -> Iterator[Line]:
    """Yield the lines of a program; raise `NotUnderstood` naming the first that is not followed."""
    motion, here = "", dict[str, float]()
    for number, text in enumerate(program.splitlines(), start=1):
        try:
            line = parse_line(text, motion, here, letters)
        except NotUnderstood as error:
            raise NotUnderstood(f"line {number}: {error}") from None
        motion = line.motion
        yield line


def steps_of(start: tuple[float, ...], end: tuple[float, ...]) -> list[np.ndarray]:
    """Divide a straight move into steps; return the end of each."""
    way = np.subtract(end, start)
    size = max(math.hypot(*way[:3]) / STEP_MM, float(np.abs(way[3:]).sum()) / STEP_DEG)
    count = max(1, math.ceil(size))
    return [np.add(start, way * step / count) for step in range(1, count + 1)]


def correct(program: str, identified_file: str, nominal_file: str) -> str:
    """Correct a program; raise `NotUnderstood`, or `TargetsInvalid` for a pose out of reach."""
    identified, nominal = find_robot(identified_file), find_robot(nominal_file)
    units = np.array([1.0 if a.unit == "mm" else math.pi / 180 for a in nominal.mechanism.task])
    letters = LETTERS[: len(units)]
    lines = list(lines_of(program, letters))
    steps, start = list[list[np.ndarray]](), None
    for line in lines:
        steps.append(steps_of(start or line.end, line.end) if line.end else [])
        start = line.end or start
    wanted = [step for steps_of_line in steps for step in steps_of_line]
    if not wanted:
        raise NotUnderstood("nothing moves: is it the right file?")
    poses = iter(correct_targets(np.array(wanted) * units, identified, nominal) / units)
    written = list[str]()
    for line, steps_of_line in zip(lines, steps, strict=True):
        if not steps_of_line:
            written.append(line.text)
            continue
        other_words = line.other_words
        for _ in steps_of_line:
            place = (f"{a}{v:.4f}" for a, v in zip(letters, next(poses), strict=True))
            written.append(" ".join([line.motion, *place, other_words]).rstrip())
            other_words = ""
    return "\n".join([*written, ""])


if __name__ == "__main__":
    source, *robots = sys.argv[1:]
    try:
        sys.stdout.write(correct(Path(source).read_text(), *robots))
    except (NotUnderstood, TargetsInvalid) as failure:
        sys.exit(f"{source}: {failure}")
