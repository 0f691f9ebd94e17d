"""Golden lines of robotline, both ways, and the specification that quotes them."""

import json
import re
from pathlib import Path

import pytest
from robotline_layouts import PAR4_LINES, TILTING_LAYOUT, command_of, outcome_of

from drivers.errors import WireError
from drivers.wire import numbered_lines as lines
from drivers.wire import robotline as wire

ROOT = Path(__file__).parents[3]
GOLDEN = json.loads((ROOT / "tests/data/robotline-golden.json").read_text())
SPECIFICATION = (ROOT / "docs/robotline.md").read_text()


def line(case):
    return case["line"]


def why(case):
    return case["why"]


@pytest.mark.parametrize("case", GOLDEN["requests"], ids=line)
def test_golden_request_is_written_and_read(case):
    request = wire.RobotlineRequest(case["sequence"], command_of(case))
    assert PAR4_LINES.encode_request(request) == case["line"].encode() + b"\n"
    assert PAR4_LINES.decode_request(case["line"].encode()) == request


@pytest.mark.parametrize("case", GOLDEN["replies"], ids=line)
def test_golden_reply_is_written_and_read(case):
    reply = wire.RobotlineReply(case["sequence"], case["verb"], outcome_of(case))
    assert PAR4_LINES.encode_reply(reply) == case["line"].encode() + b"\n"
    assert PAR4_LINES.decode_reply(case["line"].encode()) == reply
    assert PAR4_LINES.decode_reply(case["line"].encode()).line == case["line"]


@pytest.mark.parametrize("case", GOLDEN["bad_requests"], ids=why)
def test_bad_request_says_what_the_controller_must_answer(case):
    with pytest.raises(lines.BadRequest) as bad:
        PAR4_LINES.decode_request(case["line"].encode())
    if case["answer"] is None:
        assert bad.value.reply is None
    else:
        assert PAR4_LINES.encode_reply(bad.value.reply).decode().startswith(case["answer"])


@pytest.mark.parametrize("case", GOLDEN["bad_replies"], ids=why)
def test_bad_reply_is_a_wire_error(case):
    with pytest.raises(WireError):
        PAR4_LINES.decode_reply(case["line"].encode())


def test_specification_quotes_the_golden_lines_and_is_right_in_all_and_in_its_checksum():
    found = re.findall(r"^[<>]\d+ .* \*[0-9A-F]{4}$", SPECIFICATION, flags=re.MULTILINE)
    assert {case["line"] for case in GOLDEN["requests"] + GOLDEN["replies"]} <= {*found}
    tilting = wire.grammar(TILTING_LAYOUT)
    for text in found:
        decode = tilting.decode_request if text.startswith(">") else tilting.decode_reply
        assert decode(text.encode())
    (code,) = re.findall(r"```python\n(.*?)```", SPECIFICATION, flags=re.DOTALL)
    names = {}
    exec(code, names)
    for case in GOLDEN["checksums"]:
        text = case["text"].encode()
        assert names["checksum"](text) == f"{lines.checksum(text):04X}" == case["checksum"]
        assert f"`{case['text']}` | `{case['checksum']}`" in SPECIFICATION
