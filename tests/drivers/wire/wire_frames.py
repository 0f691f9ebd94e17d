"""Frames to torture wire parsers with: examples of every message, and what can become of them."""

import json
import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from random import Random
from typing import NamedTuple, get_args

from robotline_layouts import PAR4_LINES

from drivers.wire import emscon, lines, pointline
from drivers.wire.emscon_constants import Command
from drivers.wire.emscon_messages import Body, Nothing, Triple, annotations_of
from drivers.wire.framing import LineFramer, Packet, PacketFramer


class Wire(NamedTuple):
    """One parser: a fresh one for each conversation, examples, and how a line is made to fit again.

    `resealed` writes the checksum anew after a change, so that what is behind it is reached too.
    """

    name: str
    fresh: Callable[[], Callable[[bytes], object]]
    examples: Sequence[bytes]
    resealed: Callable[[bytes], bytes] = lambda frame: frame


def example(kind: type[Body]) -> Body:
    """A body of that kind."""
    values = {int: 7, float: 0.5, Triple: (1.5, -2.5, 3.5), str: "CCR-1.5in"}
    return kind(*(values[form] for form in annotations_of(kind)))


def bodies(table: Mapping[Command, type[Body]]) -> Iterator[tuple[Command, Body]]:
    """A body for each command, by the table of their types."""
    return ((command, example(table.get(command, Nothing))) for command in Command)


FROM_INSTRUMENT = (
    *(emscon.encode(emscon.Answer(c, 0, body)) for c, body in bodies(emscon.ANSWERS)),
    *(emscon.encode(example(kind)) for kind in get_args(emscon.Unasked)),
    *(emscon.refusal(command, 39) for command in (1, 42)),
    emscon.encode(Packet(3, bytes(84))),
)
FROM_CLIENT = tuple(
    emscon.encode(emscon.EmsconRequest(c, body)) for c, body in bodies(emscon.REQUESTS)
)
ROOT = Path(__file__).parents[3]
ROBOTLINE = json.loads((ROOT / "tests/data/robotline-golden.json").read_text())
"""Golden lines of robotline, with the meaning of each."""
POINTLINE_PAGE = (ROOT / "docs/reference/pointline.md").read_text(encoding="utf-8")
POINTLINE = re.findall("^[<>].+$", POINTLINE_PAGE.partition("## Golden lines")[2], re.MULTILINE)
"""Golden lines of pointline, as its page has them."""


def on_wire(golden: Iterable[str], mark: str) -> tuple[bytes, ...]:
    """The golden lines with this mark, a question's or an answer's, with their line feeds."""
    return tuple(line.encode() + b"\n" for line in golden if line.startswith(mark))


ROBOTLINE_QUESTIONS = on_wire([case["line"] for case in ROBOTLINE["requests"]], ">")
ROBOTLINE_ANSWERS = on_wire([case["line"] for case in ROBOTLINE["replies"]], "<")
POINTLINE_QUESTIONS, POINTLINE_ANSWERS = on_wire(POINTLINE, ">"), on_wire(POINTLINE, "<")


def _questions(grammar):
    """A server's reading; what it answers to a bad question can be written and read."""

    def fresh():
        framer = grammar.line_framer()
        return lambda data: [_answerable(grammar, line) for line in framer.feed(data)]

    return fresh


def _answerable(grammar, line):
    try:
        return grammar.decode_question(line)
    except lines.BadQuestion as bad:
        if bad.answer is not None:
            grammar.decode_answer(grammar.encode_answer(bad.answer)[:-1])
        raise


def resealed_line(line: bytes) -> bytes:
    """The line with the checksum that fits what stands before it."""
    text = line.rstrip(b"\n").rpartition(b" *")[0]
    return b"%s *%04X\n" % (text, lines.checksum(text))


WIRES: tuple[Wire, ...] = (
    Wire("packets", lambda: PacketFramer().feed, FROM_INSTRUMENT),
    Wire("lines", lambda: LineFramer(255).feed, ROBOTLINE_ANSWERS),
    Wire("emScon, instrument", emscon.from_server, FROM_INSTRUMENT),
    Wire("emScon, client", emscon.from_client, FROM_CLIENT),
    Wire("robotline, controller", PAR4_LINES.answer_reader, ROBOTLINE_ANSWERS, resealed_line),
    Wire("robotline, client", _questions(PAR4_LINES), ROBOTLINE_QUESTIONS, resealed_line),
    Wire(
        "pointline, instrument", pointline.GRAMMAR.answer_reader, POINTLINE_ANSWERS, resealed_line
    ),
    Wire("pointline, client", _questions(pointline.GRAMMAR), POINTLINE_QUESTIONS, resealed_line),
)

ODD = (
    *(b"\x00", b"\xff", b"\n", b"\r", b" ", b",", b'"', b"\\", b":", b"*", b"%", b"-", b"1e999"),
    *(b"nan", b"\xc2\xa0", b"\x1c", b"\xe2\x80\xae", b"\xff\xff\xff\x7f", b"\x00\x00\x00\x80"),
    *(b"9" * 40, bytes(8), b"OK", b"NO", b"ACK", b"HELLO", b"ARM 9"),
)
LONGEST_RANDOM = 400


def frame(wire: Wire, draw: Random) -> list[bytes]:
    """One torture in the pieces in which it comes: random, mutated, cut off, or run together."""
    kind = draw.random()
    if kind < 0.15:
        return [draw.randbytes(draw.randrange(LONGEST_RANDOM))]
    golden = draw.choice(wire.examples)
    if kind < 0.6:
        mutant = mutated(golden, draw)
        return [wire.resealed(mutant) if draw.random() < 0.5 else mutant]
    if kind < 0.8:
        return [golden[: draw.randrange(len(golden))], draw.choice(wire.examples)]
    some = [draw.choice(wire.examples) for _ in range(draw.randrange(2, 6))]
    some[draw.randrange(len(some))] = mutated(golden, draw)
    data = b"".join(some)
    cut = draw.randrange(len(data) + 1)
    return [data[:cut], data[cut:]]


def mutated(golden: bytes, draw: Random) -> bytes:
    """Some bytes changed, lost, doubled, or replaced by what parsers stumble over."""
    data = bytearray(golden)
    for _ in range(draw.choice((1, 1, 1, 2, 3, 8))):
        at = draw.randrange(len(data) + 1)
        match draw.randrange(5):
            case 0:
                data[at : at + 1] = bytes((draw.randrange(256),))
            case 1:
                del data[at : at + draw.randrange(1, 9)]
            case 2:
                data[at:at] = data[at : at + draw.randrange(1, 17)]
            case 3:
                data[at:at] = draw.choice(ODD)
            case _:
                odd = draw.choice(ODD)
                data[at : at + len(odd)] = odd
    return bytes(data)
