"""robotline and pointline: golden lines, what is written reads the same again, and bad lines."""

import json
import math
import re
from dataclasses import asdict, fields
from typing import get_args, get_origin

import pytest
from hypothesis import given
from hypothesis import strategies as st
from robotline_layouts import PAR4_LINES, THREE_CARRIAGES, TILTING_LAYOUT
from wire_frames import POINTLINE, POINTLINE_PAGE, ROBOTLINE, ROOT

from drivers.errors import WireError
from drivers.wire import lines, pointline, robotline
from drivers.wire.lines import Answer, Question, Refused

ROBOTLINE_PAGE = (ROOT / "docs/reference/robotline.md").read_text(encoding="utf-8")

decimals = st.floats(allow_nan=False, allow_infinity=False)
VALUES = {
    int: st.integers(0, lines.LAST_NUMBER),
    float: decimals,
    bool: st.booleans(),
    str: st.text(max_size=5).filter(str.isprintable),
    lines.Title: st.sampled_from(["PLATE", "ARM 2", "arm0.axis_tilt_deg"]),
    tuple[float, ...]: st.lists(decimals, max_size=4).map(tuple),
}


def values_of(form):
    if get_origin(form) is tuple and Ellipsis not in get_args(form):
        return st.tuples(*[decimals] * len(get_args(form)))
    return VALUES[form]


def messages_of(verbs, place):
    """A verb and the body of its question (0) or answer (1), for any robot."""
    return st.sampled_from(sorted(verbs)).flatmap(
        lambda verb: st.tuples(
            st.just(verb),
            st.builds(verbs[verb][place], *(values_of(f.type) for f in fields(verbs[verb][place]))),
        )
    )


def checked(body):
    return b"%s *%04X" % (body, lines.checksum(body))


def as_json(body):
    return json.loads(json.dumps(asdict(body)))


@pytest.mark.parametrize("case", ROBOTLINE["requests"], ids=lambda case: case["line"])
def test_golden_question_of_robotline_is_read_and_written(case):
    question = PAR4_LINES.decode_question(case["line"].encode())
    assert (question.number, question.verb) == (case["number"], case["verb"])
    assert as_json(question.body) == case["fields"]
    assert PAR4_LINES.encode_question(question) == case["line"].encode() + b"\n"


@pytest.mark.parametrize("case", ROBOTLINE["replies"], ids=lambda case: case["line"])
def test_golden_answer_of_robotline_is_read_and_written(case):
    answer = PAR4_LINES.decode_answer(case["line"].encode())
    assert (answer.number, answer.verb, answer.line) == (case["number"], case["verb"], case["line"])
    assert as_json(answer.body) == case["fields"]
    assert PAR4_LINES.encode_answer(answer) == case["line"].encode() + b"\n"


@pytest.mark.parametrize("case", ROBOTLINE["bad_requests"], ids=lambda case: case["why"])
def test_bad_question_says_what_the_controller_must_answer(case):
    with pytest.raises(lines.BadQuestion) as bad:
        PAR4_LINES.decode_question(case["line"].encode())
    if case["answer"] is None:
        assert bad.value.answer is None
    else:
        assert PAR4_LINES.encode_answer(bad.value.answer).decode().startswith(case["answer"])


@pytest.mark.parametrize("case", ROBOTLINE["bad_replies"], ids=lambda case: case["why"])
def test_bad_answer_is_a_wire_error(case):
    with pytest.raises(WireError):
        PAR4_LINES.decode_answer(case["line"].encode())


@pytest.mark.parametrize(
    "body",
    [
        "<1 MEASURE OK 1 CCR 1.0 2.0 3.0",
        "<1 MEASURE OK 1 CCR 1.0 2.0 3.0 0.0 0.0 0.0 0.0 0.0 0.0 0.0",
        "<1 MEASURE OK 1 CCR nan 2.0 3.0 0.0 0.0 0.0 0.0 0.0 0.0",
        "<1 AIR OK 20 1013.25 45.0",
    ],
)
def test_bad_answer_of_an_instrument_is_a_wire_error(body):
    with pytest.raises(WireError):
        pointline.GRAMMAR.decode_answer(checked(body.encode()))


@pytest.mark.parametrize("line", POINTLINE)
def test_golden_line_of_pointline_is_read_and_written_byte_for_byte(line):
    """What the words mean to the driver is tested there."""
    if line.startswith(">"):
        question = pointline.GRAMMAR.decode_question(line.encode())
        assert pointline.GRAMMAR.encode_question(question).decode() == f"{line}\n"
    else:
        answer = pointline.GRAMMAR.decode_answer(line.encode())
        assert pointline.GRAMMAR.encode_answer(answer).decode() == f"{line}\n"


@pytest.mark.parametrize(
    ("page", "grammar", "verbs"),
    [
        (ROBOTLINE_PAGE, robotline.grammar(TILTING_LAYOUT), ()),
        (POINTLINE_PAGE, pointline.GRAMMAR, pointline.VERBS),
    ],
)
def test_every_line_of_the_page_is_read_and_has_the_checksum_of_robotlines_program(
    page, grammar, verbs
):
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


@pytest.mark.parametrize("verbs", [robotline.VERBS, pointline.VERBS], ids=["robot", "point"])
@given(data=st.data(), number=st.integers(1, lines.LAST_NUMBER), trailing=st.binary())
def test_message_reads_as_it_was_written_whatever_trails_behind_it(verbs, data, number, trailing):
    grammar = lines.LineGrammar(verbs, pointline.LINE_BYTES)
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
