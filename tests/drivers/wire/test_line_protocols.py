"""robotline and pointline: golden lines, what is written reads the same again, and bad lines."""

import json
import math
import re
from dataclasses import asdict, fields
from pathlib import Path
from typing import get_args, get_origin

import pytest
from hypothesis import given
from hypothesis import strategies as st
from robotline_layouts import PAR4_LAYOUT, PAR4_LINES, THREE_CARRIAGES, TILTING_LAYOUT

from drivers.errors import WireError
from drivers.wire import lines, pointline, robotline
from drivers.wire.lines import Answer, Nothing, Question, Refused

ROOT = Path(__file__).parents[3]
GOLDEN = json.loads((ROOT / "tests/data/robotline-golden.json").read_text())
ROBOTLINE_PAGE = (ROOT / "docs/reference/robotline.md").read_text(encoding="utf-8")
POINTLINE_PAGE = (ROOT / "docs/reference/pointline.md").read_text(encoding="utf-8")
POINT = (2510.0123, -35.4871, -75.0019)
QUESTIONS = {
    "201 HELLO": lines.Hello(1),
    "202 STATE": Nothing(),
    "203 AIR": Nothing(),
    "204 REFLECTOR": pointline.ReadReflector(0),
    "205 PREPARE": pointline.Prepare("CCR-1.5in", 2.0),
    "206 MEASURE": Nothing(),
    "207 DIRECTION": Nothing(),
    "208 GOTO": pointline.GoTo((2510.0, -35.5, -75.0)),
    "209 FIND": pointline.Find(2500.0),
    "999999999 GOTO": pointline.GoTo((1e-07, -0.0, 1e16)),
}
ANSWERS = {
    "201 HELLO": lines.Greeting(1, "Example Metrology", "T-1000", "4711", "2.1 beta"),
    "202 STATE OK 0 1 1": pointline.InstrumentStatus(False, True, True, True, "CCR-1.5in"),
    "202 STATE OK 0 1 0": pointline.InstrumentStatus(False, True, False, False, ""),
    "203 AIR OK": pointline.Air(20.5, 1013.25, 45.0),
    "204 REFLECTOR": pointline.ReflectorDefinition(2, "CCR-1.5in", 19.05),
    "205 PREPARE OK": Nothing(),
    "206 MEASURE OK 17": pointline.PointMeasured(
        17, "CCR-1.5in", POINT, (1.6e-05, 0.0, 0.0, 1e-4, 0.0, 1e-4)
    ),
    "206 MEASURE OK 0": pointline.PointMeasured(0, "CCR-1.5in", POINT, (0.0,) * 6),
    "207 DIRECTION": pointline.BeamDirection((0.9995, -0.0141, -0.0299)),
    "208 GOTO": Nothing(),
    "209 FIND OK": Nothing(),
    "203 AIR NO": Refused("NONE", "there is no weather station"),
    "205 PREPARE NO": Refused("REFLECTOR", "there is no reflector CCR-2in"),
    "206 MEASURE NO": Refused("NOBEAM", "the beam is on no reflector"),
    "209 FIND NO": Refused("BEAM", ""),
    "210 ? NO": Refused("CHECKSUM", ""),
    "211 ? NO": Refused("VERB", ""),
}

decimals = st.floats(allow_nan=False, allow_infinity=False)
SIMPLE = {
    int: st.integers(0, lines.LAST_NUMBER),
    float: decimals,
    bool: st.booleans(),
    str: st.text(max_size=5).filter(str.isprintable),
}
OF_THE_ROBOT = {
    "joints": st.tuples(*[decimals] * 4),
    "coordinates": st.tuples(*[decimals] * 4),
    "speed_percent": st.floats(0.0, 100.0, exclude_min=True),
}
titles = st.sampled_from([*PAR4_LAYOUT.parts])


def field_values(slot):
    if slot.name in OF_THE_ROBOT:
        return OF_THE_ROBOT[slot.name]
    if get_origin(slot.type) is tuple:
        return st.tuples(*[decimals] * len(get_args(slot.type)))
    return SIMPLE[slot.type]


def bodies(kind):
    if kind is robotline.ReadPart:
        return st.builds(kind, titles)
    if kind is robotline.Part:
        counts = {name: len(names) for name, names in PAR4_LAYOUT.parts.items()}
        return titles.flatmap(
            lambda name: st.builds(kind, st.just(name), st.tuples(*[decimals] * counts[name]))
        )
    return st.builds(kind, *map(field_values, fields(kind)))


def messages_of(verbs, place):
    return st.one_of([st.tuples(st.just(v), bodies(kinds[place])) for v, kinds in verbs.items()])


GRAMMARS = pytest.mark.parametrize(
    ("grammar", "verbs"),
    [(PAR4_LINES, robotline.VERBS), (pointline.GRAMMAR, pointline.VERBS)],
    ids=["robotline", "pointline"],
)


def checksum_by_bits(data):
    """The checksum once more, as the specification describes it."""
    crc = 0xFFFF
    for byte in data:
        crc ^= byte << 8
        for _ in range(8):
            crc = (crc << 1 ^ 0x1021 if crc & 0x8000 else crc << 1) & 0xFFFF
    return crc


def checked(body):
    return b"%s *%04X" % (body, checksum_by_bits(body))


def as_json(body):
    return json.loads(json.dumps(asdict(body)))


@pytest.mark.parametrize("case", GOLDEN["requests"], ids=lambda case: case["line"])
def test_golden_question_of_robotline_is_read_and_written(case):
    question = PAR4_LINES.decode_question(case["line"].encode())
    assert (question.number, question.verb) == (case["number"], case["verb"])
    assert as_json(question.body) == case["fields"]
    assert PAR4_LINES.encode_question(question) == case["line"].encode() + b"\n"


@pytest.mark.parametrize("case", GOLDEN["replies"], ids=lambda case: case["line"])
def test_golden_answer_of_robotline_is_read_and_written(case):
    answer = PAR4_LINES.decode_answer(case["line"].encode())
    assert (answer.number, answer.verb, answer.line) == (case["number"], case["verb"], case["line"])
    assert as_json(answer.body) == case["fields"]
    assert PAR4_LINES.encode_answer(answer) == case["line"].encode() + b"\n"


@pytest.mark.parametrize("case", GOLDEN["bad_requests"], ids=lambda case: case["why"])
def test_bad_question_says_what_the_controller_must_answer(case):
    with pytest.raises(lines.BadQuestion) as bad:
        PAR4_LINES.decode_question(case["line"].encode())
    if case["answer"] is None:
        assert bad.value.answer is None
    else:
        assert PAR4_LINES.encode_answer(bad.value.answer).decode().startswith(case["answer"])


@pytest.mark.parametrize("case", GOLDEN["bad_replies"], ids=lambda case: case["why"])
def test_bad_answer_is_a_wire_error(case):
    with pytest.raises(WireError):
        PAR4_LINES.decode_answer(case["line"].encode())


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
def test_bad_answer_of_an_instrument_is_a_wire_error(body):
    with pytest.raises(WireError):
        pointline.GRAMMAR.decode_answer(checked(body.encode()))


def golden_line(key):
    """The line of pointline's golden lines that begins so."""
    section = POINTLINE_PAGE.partition("## Golden lines")[2]
    (line,) = [text for text in section.splitlines() if text.startswith(f"{key} ")]
    return line


@pytest.mark.parametrize("key", QUESTIONS)
def test_golden_question_of_pointline_is_written_and_read(key):
    number, verb = key.split()
    question = Question(int(number), verb, QUESTIONS[key])
    assert pointline.GRAMMAR.encode_question(question).decode() == golden_line(f">{key}") + "\n"
    assert pointline.GRAMMAR.decode_question(golden_line(f">{key}").encode()) == question


@pytest.mark.parametrize("key", ANSWERS)
def test_golden_answer_of_pointline_is_written_and_read(key):
    number, verb, *_ = key.split()
    answer = Answer(int(number), verb, ANSWERS[key])
    assert pointline.GRAMMAR.encode_answer(answer).decode() == golden_line(f"<{key}") + "\n"
    assert pointline.GRAMMAR.decode_answer(golden_line(f"<{key}").encode()) == answer


@pytest.mark.parametrize(
    ("page", "grammar", "verbs"),
    [
        (ROBOTLINE_PAGE, robotline.grammar(TILTING_LAYOUT), ()),
        (POINTLINE_PAGE, pointline.GRAMMAR, pointline.VERBS),
    ],
)
def test_every_line_of_the_page_is_read_and_has_robotlines_checksum(page, grammar, verbs):
    quoted = re.findall(r"^[<>]\d+ .* \*[0-9A-F]{4}$", page, flags=re.MULTILINE)
    assert len(quoted) > 20
    (code,) = re.findall(r"```python\n(.*?)```", ROBOTLINE_PAGE, flags=re.DOTALL)
    program = {}
    exec(code, program)
    for line in quoted:
        text, _, checksum = line.rpartition(" *")
        assert program["checksum"](text.encode()) == checksum
        decode = grammar.decode_question if line.startswith(">") else grammar.decode_answer
        assert decode(line.encode())
    assert {*verbs} <= {*re.findall(r"^\| `([A-Z]+)[^`]*` \|", page, flags=re.MULTILINE)}


@GRAMMARS
@given(data=st.data(), number=st.integers(1, lines.LAST_NUMBER), trailing=st.binary())
def test_message_reads_as_it_was_written_whatever_trails_behind_it(
    grammar, verbs, data, number, trailing
):
    question = Question(number, *data.draw(messages_of(verbs, 0)))
    first, *_ = grammar.line_framer().feed(grammar.encode_question(question) + trailing)
    assert grammar.decode_question(first) == question
    answer = Answer(number, *data.draw(messages_of(verbs, 1)))
    first, *_ = grammar.line_framer().feed(grammar.encode_answer(answer) + trailing)
    assert grammar.decode_answer(first) == answer


@given(st.text(max_size=600))
def test_any_text_of_a_refusal_fits_into_a_line(text):
    line = PAR4_LINES.encode_answer(Answer(lines.LAST_NUMBER, "ABANDON", Refused("BUSY", text)))
    assert len(line) <= robotline.LINE_BYTES
    assert PAR4_LINES.decode_answer(line[:-1]).body.code == "BUSY"


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_number_that_is_not_finite_is_never_sent(value):
    with pytest.raises(WireError, match="not a finite number"):
        PAR4_LINES.encode_question(Question(1, "MOVEJ", robotline.MoveJoints((0.0, value), 10.0)))


def test_longest_lines_are_read_and_longer_ones_neither_read_nor_sent():
    room = robotline.LINE_BYTES - len(b"<1 STOP NO FAULT  *0000\n")
    longest = checked(b"<1 STOP NO FAULT " + b"x" * room)
    assert PAR4_LINES.decode_answer(longest).body.code == "FAULT"
    with pytest.raises(WireError, match="more than 255 bytes"):
        PAR4_LINES.decode_answer(checked(b"<1 STOP NO FAULT " + b"x" * (room + 1)))
    status = robotline.ControllerStatus(False, False, "x" * 300, (0.0,) * 4)
    with pytest.raises(WireError, match="limit is 255"):
        PAR4_LINES.encode_answer(Answer(1, "STATE", status))


def test_number_of_a_question_starts_again_after_the_last():
    numbers = lines.numbers_from(lines.LAST_NUMBER - 1)
    assert [next(numbers) for _ in range(4)] == [lines.LAST_NUMBER - 1, lines.LAST_NUMBER, 1, 2]


def test_parameters_keep_their_names_through_the_parts():
    flat = {name: float(n) for n, name in enumerate(PAR4_LAYOUT.parameters)}
    assert len(flat) == 29
    again = {}
    for part in PAR4_LAYOUT.parts_of(flat):
        again |= PAR4_LAYOUT.flat(part)
    assert again == flat


def test_another_robot_has_other_words():
    """Three joints, no turn, and no parameter beside those of its arms."""
    carriages = robotline.grammar(THREE_CARRIAGES)
    moved = Question(1, "MOVEJ", robotline.MoveJoints((1.0, 2.0, 3.0), 50.0))
    line = PAR4_LINES.encode_question(moved)[:-1]
    assert carriages.decode_question(line) == moved
    with pytest.raises(lines.BadQuestion, match="3 joints, 4 are needed"):
        PAR4_LINES.decode_question(line)
    assert list(THREE_CARRIAGES.parts) == ["ARM 0", "ARM 1", "ARM 2"]
    for title in ("PLATE", "ARM 3", "ARM 01"):
        with pytest.raises(lines.BadQuestion):
            carriages.decode_question(checked(f">1 GEOM {title}".encode()))


@given(st.data())
def test_no_damage_of_two_bytes_goes_unseen(data):
    whole = bytearray(checked(b">103 MOVEJ 12.5 -7.25 0.0 90.0 25.0"))
    at = data.draw(st.integers(0, len(whole) - 2))
    damaged = bytes(whole[:at]) + data.draw(st.binary(min_size=2, max_size=2)) + whole[at + 2 :]
    if damaged != bytes(whole):
        with pytest.raises(lines.BadQuestion):
            PAR4_LINES.decode_question(damaged)
