"""Targets of robot programs: the poses that stand in RAPID, KRL, V+ and CSV, found and corrected.

A pose is a literal of numbers; nothing else of the text changes. What would make its numbers mean
something else than a place of the controlled point in the base frame is refused by its line.
"""

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np

from campaigns.arrays import Array
from campaigns.controllers.corrected_targets import CorrectedFile, TargetCorrection, correction_mm
from campaigns.errors import TargetsInvalid
from campaigns.files.csv_file import fixed_text
from campaigns.files.wording import shown
from campaigns.mechanisms.mechanism import Axis
from campaigns.shots.columns import axis_columns

DECIMALS = 4
UPRIGHT_DEG = 0.01
"""Largest tilt of a tool out of the vertical: a plate does not tilt."""
UPRIGHT_QUATERNION = 1e-4
NUMBER = r"[+-]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][+-]?\d+)?"
_N = re.compile(NUMBER)
_number = partial(fixed_text, decimals=DECIMALS)
Numbers = Mapping[str, float]
Texts = dict[str, str]


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """Pose (t,) of a program, rad and mm, where its numbers stand, and how its turn is written."""

    line: int
    pose: Array
    spans: Mapping[str, tuple[int, int]]
    turned: Callable[[float], Texts]
    """Texts of the numbers of a turn, rad."""


@dataclass(frozen=True, slots=True)
class Syntax:
    """What a language's poses look like."""

    comment: str
    """Pattern of what is passed over: comments and strings."""
    literal: str
    """Pattern of a pose, whatever stands in it."""
    numbers: Callable[[re.Match[str]], Mapping[str, tuple[int, int]] | None]
    """Places of its numbers by name; None where they are no numbers."""
    turn: Callable[[Numbers], tuple[float, Callable[[float], Texts]] | None]
    """Turn in rad and how another is written; None for a tool that is tilted."""
    refused: tuple[tuple[str, str, str], ...]
    """Patterns of what cannot be corrected, why, and what to do."""


def targets_of(text: str, name: str, language: str, task: Sequence[Axis]) -> list[Target]:
    """Targets of a program in the order of the text; raises `TargetsInvalid` naming the line."""
    if language == "csv":
        return list(_csv_targets(text, name, task))
    syntax = SYNTAXES[language]
    bare = re.sub(syntax.comment, lambda found: " " * len(found[0]), text, flags=re.MULTILINE)
    for pattern, why, remedy in syntax.refused:
        if found := re.search(pattern, bare, re.IGNORECASE | re.MULTILINE):
            raise _refused(text, name, found.start(), f"'{shown(found[0].strip())}': {why}", remedy)
    has_turn, targets = any(axis.is_revolute for axis in task), list[Target]()
    for found in re.finditer(syntax.literal, bare, re.IGNORECASE):
        spans = syntax.numbers(found)
        if spans is None:
            raise _refused(
                text,
                name,
                found.start(),
                f"'{shown(found[0])}' is no pose of numbers",
                "write all its numbers out",
            )
        values = {key: float(text[slice(*span)]) for key, span in spans.items()}
        pose = [values["x"], values["y"], values["z"]]
        turned: Callable[[float], Texts] = _unturned
        if has_turn:
            turn = syntax.turn(values)
            if turn is None:
                raise _refused(
                    text,
                    name,
                    found.start(),
                    f"'{shown(found[0])}': the tool is tilted, which a plate cannot do",
                    "let its z point straight up or down",
                )
            pose.append(turn[0])
            turned = turn[1]
        targets.append(Target(_line(text, found.start()), np.array(pose), spans, turned))
    return targets


def correct_program(
    text: str, name: str, language: str, correction: TargetCorrection
) -> CorrectedFile:
    """Correct a program's targets; raises `TargetsInvalid` naming the line that cannot be.

    Joints may come from either side, for nobody knows the order: of backlash half stays.
    """
    targets = targets_of(text, name, language, correction.identified.mechanism.task)
    if not targets:
        raise TargetsInvalid(
            f"{name}: holds no pose", remedy="check file and --format; joints need no correction"
        )
    wanted = np.array([target.pose for target in targets])
    correction.require_possible(wanted, lambda row: f"{name}:{targets[row].line}", "target")
    commanded = correction.commanded(wanted).values_or_raise()
    written, size_mm = _written(text, targets, commanded), correction_mm(wanted, commanded)
    return CorrectedFile.of(written, len(targets), size_mm, correction.std_mm(wanted))


def _written(text: str, targets: Sequence[Target], commanded: Array) -> str:
    changes: list[tuple[int, int, str]] = []
    for target, pose in zip(targets, commanded.tolist(), strict=True):
        told = {key: _number(value) for key, value in zip("xyz", pose, strict=False)}
        told |= target.turned(pose[3]) if len(pose) > len("xyz") else {}
        changes += [(*target.spans[key], word) for key, word in told.items()]
    parts, end = list[str](), 0
    for first, last, word in sorted(changes):
        parts += [text[end:first], word]
        end = last
    return "".join([*parts, text[end:]])


def _unturned(_: float) -> Texts:
    return {}


def _line(text: str, place: int) -> int:
    return text.count("\n", 0, place) + 1


def _refused(text: str, name: str, place: int, problem: str, remedy: str) -> TargetsInvalid:
    return TargetsInvalid(f"{name}:{_line(text, place)}: {problem}", remedy=remedy)


def _listed(names: Sequence[str]) -> Callable[[re.Match[str]], dict[str, tuple[int, int]] | None]:
    """Reader of numbers that stand in this order, separated by commas and brackets."""

    def read(found: re.Match[str]) -> dict[str, tuple[int, int]] | None:
        words = list(re.finditer(r"[^\[\](),\s]+", found["body"]))[: len(names)]
        if len(words) < len(names) or not all(_N.fullmatch(each[0]) for each in words):
            return None
        begin = found.start("body")
        spans = ((begin + each.start(), begin + each.end()) for each in words)
        return dict(zip(names, spans, strict=True))

    return read


def _named(found: re.Match[str]) -> dict[str, tuple[int, int]] | None:
    """Places of the numbers of `X 1.0, Y …`; None where one of X, Y, Z, A, B, C is missing."""
    begin, spans = found.start("body"), {}
    for each in re.finditer(rf"\b([XYZABC])\s+({NUMBER})(?=\s*(?:,|$))", found["body"], re.I):
        spans[each[1].lower()] = (begin + each.start(2), begin + each.end(2))
    return spans if spans.keys() == set("xyzabc") else None


def _rapid_turn(values: Numbers) -> tuple[float, Callable[[float], Texts]] | None:
    w, i, j, k = (values[name] for name in ("q1", "q2", "q3", "q4"))
    for tilted, cosine, sine, names in (((i, j), w, k, "14"), ((w, k), i, j, "23")):
        if max(map(abs, tilted)) < UPRIGHT_QUATERNION:
            angle = 2.0 * math.atan2(sine, cosine)
            sign = 1.0 if abs(angle) <= math.pi else -1.0  # the same turn, written by −q

            def written(
                turn: float, names: str = names, sign: float = sign
            ) -> Texts:  # bound now: the loop goes on
                parts = (math.cos(turn / 2.0), math.sin(turn / 2.0))
                each = zip(names, parts, strict=True)
                return {f"q{name}": fixed_text(sign * part, 9) for name, part in each}

            return math.remainder(angle, 2.0 * math.pi), written
    return None


def _krl_turn(values: Numbers) -> tuple[float, Callable[[float], Texts]] | None:
    up = abs(math.remainder(values["c"], 180.0)) < UPRIGHT_DEG
    if not up or abs(values["b"]) > UPRIGHT_DEG:
        return None
    turn = math.remainder(values["a"], 360.0)
    return math.radians(turn), lambda angle: {"a": _number(math.degrees(angle))}


def _vplus_turn(values: Numbers) -> tuple[float, Callable[[float], Texts]] | None:
    yaw, pitch, roll = values["yaw"], values["pitch"], values["roll"]
    if abs(math.remainder(pitch, 180.0)) > UPRIGHT_DEG:
        return None
    sign = 1.0 if abs(math.remainder(pitch, 360.0)) < UPRIGHT_DEG else -1.0
    turn = math.radians(math.remainder(yaw + sign * roll, 360.0))
    return turn, lambda angle: {"roll": _number(sign * (math.degrees(angle) - yaw))}


def _csv_targets(text: str, name: str, task: Sequence[Axis]) -> Iterator[Target]:
    columns, head = axis_columns(task), list[str]()
    place = 0
    for number, line in enumerate(text.splitlines(keepends=True), start=1):
        cells = list(re.finditer(r'(?:^|,)("(?:[^"]|"")*"|[^,\r\n]*)', line))
        words = [cell[1].strip() for cell in cells]
        if not head:
            head = [word.strip('"') for word in words]
            if missing := [column for column in columns if column not in head]:
                raise _refused(text, name, place, f"no column {missing[0]}", "name it so")
            if "q0_deg" in head or "q0_mm" in head:
                raise _refused(
                    text,
                    name,
                    place,
                    "joints stand beside the poses, and would no longer be theirs",
                    "take these columns out",
                )
        elif any(words):
            yield _csv_target(text, name, place, number, columns, head, cells, task)
        place += len(line)


def _csv_target(
    text: str,
    name: str,
    place: int,
    number: int,
    columns: Sequence[str],
    head: Sequence[str],
    cells: Sequence[re.Match[str]],
    task: Sequence[Axis],
) -> Target:
    if len(cells) != len(head):
        raise _refused(text, name, place, f"{len(cells)} columns, not {len(head)}", "correct it")
    own = [cells[head.index(column)] for column in columns]
    words = [cell[1].strip() for cell in own]
    if wrong := [word for word in words if not _N.fullmatch(word)]:
        raise _refused(text, name, place, f"'{shown(wrong[0])}' is no number", "correct the value")
    keys = [*"xyz", "turn"][: len(task)]
    spans = {k: (place + c.start(1), place + c.end(1)) for k, c in zip(keys, own, strict=True)}
    pose = [axis.from_file(float(word)) for axis, word in zip(task, words, strict=True)]
    return Target(
        number, np.array(pose), spans, lambda angle: {"turn": _number(math.degrees(angle))}
    )


_FRAMES = "its frame is not the base"
_TO_BASE = "give targets in the base frame, of the flange without a tool"
_DERIVED = "a target worked out by the controller"
_WRITE_OUT = "write the target out as numbers"
_BRACKET = r"\[[^\[\]]*\]"

SYNTAXES: Mapping[str, Syntax] = {
    "rapid": Syntax(
        comment=r'"(?:[^"\n]|"")*"|!.*',
        literal=rf"\[\s*(?P<body>{_BRACKET}\s*,\s*{_BRACKET})\s*,\s*{_BRACKET}\s*,\s*{_BRACKET}\s*\]",
        numbers=_listed(("x", "y", "z", "q1", "q2", "q3", "q4")),
        turn=_rapid_turn,
        refused=(
            (r"\\WObj\s*:=\s*(?!wobj0\b)\w+", _FRAMES, _TO_BASE),
            (
                r"\bMove[JLC]\w*\b[^;]*,\s*(?!tool0\b)[a-z]\w*\s*(?:\\[^;]*)?;",
                "its tool is not tool0",
                _TO_BASE,
            ),
            (
                r"\b(?:Offs|RelTool|PDispOn|PDispSet|CRobT|CalcRobT|PoseMult|ORobT)\b|\.(?:trans|rot)\b",
                _DERIVED,
                _WRITE_OUT,
            ),
        ),
    ),
    "krl": Syntax(
        comment=r'"[^"\n]*"|;.*|^&.*',
        literal=r"\{(?:\s*\w+\s*:)?(?P<body>\s*[XYZ]\s[^{}]*)\}",
        numbers=_named,
        turn=_krl_turn,
        refused=(
            (r"\$(?:BASE|TOOL)\s*=\s*(?!\$NULLFRAME)\S+", _FRAMES, _TO_BASE),
            (r"#(?:BASE|TOOL)\s*,\s*0*[1-9]\d*|\b(?:BASE|TOOL)_NO\s+0*[1-9]\d*", _FRAMES, _TO_BASE),
            (
                r"\b(?:S?LIN|S?PTP|S?CIRC)_REL\b|\w\.[XYZABC]\s*=|\}\s*:|:\s*\{",
                _DERIVED,
                _WRITE_OUT,
            ),
        ),
    ),
    "vplus": Syntax(
        comment=r'"[^"\n]*"|;.*',
        literal=r"\bTRANS\s*\((?P<body>[^()]*)\)",
        numbers=_listed(("x", "y", "z", "yaw", "pitch", "roll")),
        turn=_vplus_turn,
        refused=(
            (r"^[ \t]*(?:TOOL[ \t]+(?!NULL\b)|BASE[ \t]+)\S+", _FRAMES, _TO_BASE),
            (
                r"\b(?:APPROS?|DEPARTS?|SHIFT|RTRANS|HERE|FRAME|INVERSE|SCALE)\b|TRANS\s*\([^()]*\)\s*:",
                _DERIVED,
                _WRITE_OUT,
            ),
            (r"\w\s*:\s*(?:TRANS\b|[a-z][\w.]*)|^\.LOCATIONS", _DERIVED, _WRITE_OUT),
        ),
    ),
}
