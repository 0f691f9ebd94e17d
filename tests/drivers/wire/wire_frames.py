"""Frames to torture wire parsers with: examples of every message, and what can become of them."""

from collections.abc import Callable, Sequence
from itertools import pairwise
from random import Random
from typing import NamedTuple

from drivers.wire import emscon, emscon_messages, lines, pointline, robotline
from drivers.wire.emscon_constants import Command
from drivers.wire.framing import LineFramer, Packet, PacketFramer
from drivers.wire.lines import Answer, Hello, Nothing, Question, Refused
from sim.geometry import PAR4
from sim.servers.robotline_server import layout_of


class Wire(NamedTuple):
    """One parser: a fresh one for each conversation, examples, and how a line is made to fit again.

    `resealed` writes the checksum anew after a change, so that what is behind it is reached too.
    """

    name: str
    fresh: Callable[[], Callable[[bytes], object]]
    examples: Sequence[bytes]
    resealed: Callable[[bytes], bytes] = lambda frame: frame


def example(kind: type[emscon_messages.Body]) -> emscon_messages.Body:
    """A body in which no two fields are alike."""
    values = {int: 7, float: 0.5, emscon_messages.Triple: (1.5, -2.5, 3.5), str: "CCR-1.5in"}
    return kind(*(values[form] for form in emscon_messages.annotations_of(kind)))


UNASKED = (
    emscon_messages.ErrorResponse,
    emscon_messages.StatusChange,
    emscon_messages.ReflectorPosition,
    emscon_messages.SingleResult,
    emscon_messages.SingleResult2,
)
FROM_INSTRUMENT = (
    *(
        emscon.encode(emscon.Answer(c, 0, example(emscon.ANSWERS.get(c, emscon_messages.Nothing))))
        for c in Command
    ),
    *(emscon.encode(example(kind)) for kind in UNASKED),  # type: ignore[arg-type] # all are of the union
    *(emscon.refusal(command, 39) for command in (1, 42)),
    emscon.encode(Packet(3, bytes(84))),
)
FROM_CLIENT = tuple(
    emscon.encode(emscon.EmsconRequest(c, example(emscon.REQUESTS.get(c, emscon_messages.Nothing))))
    for c in Command
)
LAYOUT = layout_of(PAR4)
PAR4_LINES = robotline.grammar(LAYOUT)
PART = robotline.Part(
    "ARM 0", tuple(1.5 * each for each in range(1, 1 + len(LAYOUT.parts["ARM 0"])))
)
ROBOTLINE_ANSWERS = tuple(
    PAR4_LINES.encode_answer(Answer(7, verb, body))
    for verb, body in (
        ("HELLO", robotline.ControllerGreeting(1, "Example Robotics", "Par4", "SN-42", "2.1", 4)),
        ("STATE", robotline.ControllerStatus(False, False, "drive 2", (0.0, -45.0, 90.0, 1e-300))),
        ("MOVEJ", robotline.MotionBegun(1.5)),
        ("GEOM", PART),
        ("STOP", Nothing()),
        ("MOVEP", Refused("LIMIT", "joint 3 to 95.0 deg, limit 90.0 deg")),
    )
)
ROBOTLINE_QUESTIONS = tuple(
    PAR4_LINES.encode_question(Question(7, verb, body))
    for verb, body in (
        ("HELLO", Hello(1)),
        ("STATE", Nothing()),
        ("MOVEJ", robotline.MoveJoints((0.0, 90.0, -45.0, 1.5), 25.0)),
        ("MOVEP", robotline.MovePose((1.5, -2.5, -575.0, 45.0), 100.0)),
        ("GEOM", robotline.ReadPart("ARM 0")),
        ("STAGE", PART),
        ("COMMIT", Nothing()),
    )
)
POINTLINE_ANSWERS = tuple(
    pointline.GRAMMAR.encode_answer(Answer(7, verb, body))
    for verb, body in (
        ("HELLO", lines.Greeting(1, "Example Metrology", "T", "4711", "2.1")),
        ("STATE", pointline.InstrumentStatus(False, True, True, True, "CCR 1.5")),
        ("REFLECTOR", pointline.ReflectorDefinition(2, "CCR 1.5", 19.05)),
        ("MEASURE", pointline.PointMeasured(9, "CCR", (2e3, -1.5, 1e-300), (1e-4,) * 6)),
        ("PREPARE", Nothing()),
        ("FIND", Refused("BEAM", "nothing was found")),
    )
)
POINTLINE_QUESTIONS = tuple(
    pointline.GRAMMAR.encode_question(Question(7, verb, body))
    for verb, body in (
        ("HELLO", Hello(1)),
        ("MEASURE", Nothing()),
        ("PREPARE", pointline.Prepare("CCR 1.5", 2.0)),
        ("GOTO", pointline.GoTo((1.5, -2.5, 1e300))),
    )
)


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
    Wire("robotline, controller", PAR4_LINES.answers, ROBOTLINE_ANSWERS, resealed_line),
    Wire("robotline, client", _questions(PAR4_LINES), ROBOTLINE_QUESTIONS, resealed_line),
    Wire("pointline, instrument", pointline.GRAMMAR.answers, POINTLINE_ANSWERS, resealed_line),
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
    return pieces(b"".join(some), draw)


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


def pieces(data: bytes, draw: Random) -> list[bytes]:
    """The same bytes as a wire may bring them."""
    cuts = sorted(draw.randrange(len(data) + 1) for _ in range(draw.randrange(4)))
    edges = [0, *cuts, len(data)]
    return [data[a:b] for a, b in pairwise(edges)]
