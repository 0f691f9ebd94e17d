"""The grammar of pointline: its golden lines, and what is written reads the same again."""

import re
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.errors import WireError
from drivers.wire import numbered_lines as lines
from drivers.wire import pointline as wire

SPECIFICATION = (Path(__file__).parents[3] / "docs/pointline.md").read_text(encoding="utf-8")
POINT = (2510.0123, -35.4871, -75.0019)
NONE_STATED = (0.0,) * 6
QUESTIONS = {
    "201 HELLO": wire.Hello(1),
    "202 STATE": wire.Order.STATE,
    "203 AIR": wire.Order.AIR,
    "204 REFLECTOR": wire.ReadReflector(0),
    "205 PREPARE": wire.Prepare("CCR-1.5in", 2.0),
    "206 MEASURE": wire.Order.MEASURE,
    "207 DIRECTION": wire.Order.DIRECTION,
    "208 GOTO": wire.GoTo((2510.0, -35.5, -75.0)),
    "209 FIND": wire.Find(2500.0),
    "999999999 GOTO": wire.GoTo((1e-07, -0.0, 1e16)),
}
ANSWERS = {
    "201 HELLO": wire.InstrumentGreeting(1, "Example Metrology", "T-1000", "4711", "2.1 beta"),
    "202 STATE OK 0 1 1": wire.InstrumentStatus(False, True, True, True, "CCR-1.5in"),
    "202 STATE OK 0 1 0": wire.InstrumentStatus(False, True, False, False, ""),
    "203 AIR OK": wire.Air(20.5, 1013.25, 45.0),
    "204 REFLECTOR": wire.ReflectorDefinition(2, "CCR-1.5in", 19.05),
    "205 PREPARE OK": wire.CommandDone(),
    "206 MEASURE OK 17": wire.PointMeasured(
        17, "CCR-1.5in", POINT, (1.6e-05, 0.0, 0.0, 1e-4, 0.0, 1e-4)
    ),
    "206 MEASURE OK 0": wire.PointMeasured(0, "CCR-1.5in", POINT, NONE_STATED),
    "207 DIRECTION": wire.BeamDirection((0.9995, -0.0141, -0.0299)),
    "208 GOTO": wire.CommandDone(),
    "209 FIND OK": wire.CommandDone(),
    "203 AIR NO": lines.Refused("NONE", "there is no weather station"),
    "205 PREPARE NO": lines.Refused("REFLECTOR", "there is no reflector CCR-2in"),
    "206 MEASURE NO": lines.Refused("NOBEAM", "the beam is on no reflector"),
    "209 FIND NO": lines.Refused("BEAM", ""),
    "210 ? NO": lines.Refused("CHECKSUM", ""),
    "211 ? NO": lines.Refused("VERB", ""),
}

numbers = st.floats(allow_nan=False, allow_infinity=False)
places = st.tuples(numbers, numbers, numbers)
names = st.text(max_size=5).filter(str.isprintable)
wholes = st.integers(0, lines.LAST_SEQUENCE)
any_command = st.one_of(
    st.builds(wire.Hello, wholes),
    st.builds(wire.ReadReflector, wholes),
    st.builds(wire.Prepare, names, numbers),
    st.builds(wire.GoTo, places),
    st.builds(wire.Find, numbers),
    st.sampled_from(wire.Order),
)
any_outcome = st.one_of(
    st.tuples(st.just("HELLO"), st.builds(wire.InstrumentGreeting, wholes, *[names] * 4)),
    st.tuples(st.just("STATE"), st.builds(wire.InstrumentStatus, *[st.booleans()] * 4, names)),
    st.tuples(st.just("AIR"), st.builds(wire.Air, numbers, numbers, numbers)),
    st.tuples(st.just("REFLECTOR"), st.builds(wire.ReflectorDefinition, wholes, names, numbers)),
    st.tuples(
        st.just("MEASURE"),
        st.builds(wire.PointMeasured, wholes, names, places, st.tuples(*[numbers] * 6)),
    ),
    st.tuples(st.just("DIRECTION"), st.builds(wire.BeamDirection, places)),
    st.tuples(st.sampled_from(["PREPARE", "GOTO", "FIND"]), st.just(wire.CommandDone())),
)


def golden(mark, key):
    """The lines of the page's last section that begin so; one."""
    section = SPECIFICATION.partition("## Golden lines")[2]
    (line,) = [each for each in section.splitlines() if each.startswith(mark + key + " ")]
    return line


@pytest.mark.parametrize("key", QUESTIONS)
def test_golden_question_of_the_page_is_written_and_read(key):
    request = wire.PointlineRequest(int(key.split()[0]), QUESTIONS[key])
    assert wire.GRAMMAR.encode_request(request).decode() == golden(">", key) + "\n"
    assert wire.GRAMMAR.decode_request(golden(">", key).encode()) == request


@pytest.mark.parametrize("key", ANSWERS)
def test_golden_answer_of_the_page_is_written_and_read(key):
    number, verb, *_ = key.split()
    reply = wire.PointlineReply(int(number), verb, ANSWERS[key])
    assert wire.GRAMMAR.encode_reply(reply).decode() == golden("<", key) + "\n"
    assert wire.GRAMMAR.decode_reply(golden("<", key).encode()) == reply


def test_every_line_of_the_page_is_known_here_and_its_checksum_program_is_right():
    found = re.findall(r"^[<>]\d+ .* \*[0-9A-F]{4}$", SPECIFICATION, flags=re.MULTILINE)
    assert len({*found}) == len(QUESTIONS) + len(ANSWERS)
    (code,) = re.findall(r"```python\n(.*?)```", SPECIFICATION, flags=re.DOTALL)
    program = {}
    exec(code, program)
    for line in found:
        text, _, told = line.rpartition(" *")
        assert program["checksum"](text.encode()) == told
    assert program["checksum"](b"123456789") == "29B1"


def test_table_of_verbs_is_that_of_the_program():
    verbs = re.findall(r"^\| `([A-Z]+)[^`]*` \|", SPECIFICATION, flags=re.MULTILINE)
    assert verbs == [*wire.MESSAGES]


@given(st.integers(1, lines.LAST_SEQUENCE), any_command)
def test_question_reads_as_it_was_written(sequence, command):
    request = wire.PointlineRequest(sequence, command)
    assert wire.GRAMMAR.decode_request(wire.GRAMMAR.encode_request(request)[:-1]) == request


@given(st.integers(1, lines.LAST_SEQUENCE), any_outcome, st.binary())
def test_answer_reads_as_it_was_written_whatever_trails_behind_it(sequence, told, trailing):
    reply = wire.PointlineReply(sequence, *told)
    first, *_ = wire.GRAMMAR.line_framer().feed(wire.GRAMMAR.encode_reply(reply) + trailing)
    assert wire.GRAMMAR.decode_reply(first) == reply


@pytest.mark.parametrize(
    "body",
    [
        "<1 MEASURE OK 1 CCR 1.0 2.0 3.0",
        "<1 MEASURE OK 1 CCR 1.0 2.0 3.0 0.0 0.0 0.0 0.0 0.0 0.0 0.0",
        "<1 MEASURE OK 1 CCR nan 2.0 3.0 0.0 0.0 0.0 0.0 0.0 0.0",
        "<1 MEASURE OK -1 CCR 1.0 2.0 3.0 0.0 0.0 0.0 0.0 0.0 0.0",
        "<1 STATE OK 0 1 1 2 CCR",
        "<1 AIR OK 20 1013.25 45.0",
    ],
)
def test_answer_of_another_form_is_a_wire_error(body):
    with pytest.raises(WireError):
        wire.GRAMMAR.decode_reply(b"%s *%04X" % (body.encode(), lines.checksum(body.encode())))
