"""G-code: words in, words out, and what is refused by its line."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from refusals import refusal

from campaigns.controllers.gcode import parse_gcode, read_program
from campaigns.controllers.gcode_moves import Move, moves_of
from campaigns.errors import TargetsInvalid
from campaigns.mechanisms.catalog import MECHANISMS

PAR4, DELTA = MECHANISMS["par4"].task, MECHANISMS["delta"].task
FIRST = "G21 G90 G17\nG0 X0 Y0 Z-500\n"


def moves(text, task=DELTA, rotary="C"):
    lines = moves_of(parse_gcode(text, "part.ngc"), "part.ngc", task, rotary)
    return tuple(line for line in lines if isinstance(line, Move))


def refused(text, task=DELTA):
    return refusal(TargetsInvalid, moves, text, task)


def test_modal_state_is_followed():
    found = moves(FIRST + "g01x10.5 F600\nY-2(side)\nN30 G0 Z-.5e\n".replace("e", "") + "X1Y1Z1\n")
    assert [move.end for move in found] == [
        (0.0, 0.0, -500.0),
        (10.5, 0.0, -500.0),
        (10.5, -2.0, -500.0),
        (10.5, -2.0, -0.5),
        (1.0, 1.0, 1.0),
    ]
    assert [move.rapid for move in found] == [True, False, False, True, True]
    assert [move.start for move in found] == [None, *(move.end for move in found[:-1])]


def test_the_turn_is_in_degrees_and_its_letter_is_an_option():
    text = "G1 X0 Y0 Z-500 A90\nA-90\n"
    found = moves(text, PAR4, "A")
    assert [move.end[3] for move in found] == pytest.approx([math.pi / 2.0, -math.pi / 2.0])
    assert "part.ngc:1: A90: the robot's axes are X Y Z C" in refused(text, PAR4)


@pytest.mark.parametrize(
    ("line", "sweep", "end"),
    [
        ("G3 X0 Y10 I-10 J0", math.pi / 2.0, (0.0, 10.0)),
        ("G2 X0 Y10 I-10 J0", -1.5 * math.pi, (0.0, 10.0)),
        ("G3 I-10", 2.0 * math.pi, (10.0, 0.0)),
        ("G2 X10 I-10", -2.0 * math.pi, (10.0, 0.0)),
        ("G2 X10 Y0 I-10 J0 P1 Z-510", -2.0 * math.pi, (10.0, 0.0)),
    ],
)
def test_arcs_in_the_plane(line, sweep, end):
    arc = moves(FIRST + "G1 X10\n" + line)[-1]
    assert arc.centre_mm == pytest.approx((0.0, 0.0))
    assert arc.sweep_rad == pytest.approx(sweep)
    assert arc.end[:2] == pytest.approx(end)


def test_the_first_move_gives_all_axes_and_homing_forgets_them():
    assert "the move gives no Z" in refused("G1 X1 Y2\n")
    assert "the move gives no C" in refused("G1 X1 Y2 Z-500\n", PAR4)
    assert "coordinates without a G0 or G1" in refused("X1 Y2 Z3\n")
    assert "not known where the robot stands" in refused("G2 X1 Y2 Z3 I1\n")
    text = "G0 X0 Y0 Z-500\nG28\nG1 X5\n"
    assert "part.ngc:3: it is not known where the robot stands, and the move gives no Y" in refused(
        text
    )
    assert moves("G28\nG1 X5 Y0 Z-500\n")[0].start is None


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("G1.0000000001 X5", "G1.0000000001 cannot be corrected"),
        ("M98.00000000 P1", "M98 brings other modes back"),
        ("G91", "G91 cannot be corrected → write absolute"),
        ("G20", "G20 cannot be corrected → write the program in mm"),
        ("G92 X0", "G92 cannot be corrected"),
        ("G10 L2 P1 X5", "G10 cannot be corrected"),
        ("G52 X5", "G52 cannot be corrected"),
        ("G55", "G55 cannot be corrected"),
        ("G81 X1 Z-3 R1", "G81 cannot be corrected → let the CAM write cycles out"),
        ("G93", "G93 cannot be corrected → give feeds in mm/min"),
        ("G90.1", "G90.1 cannot be corrected"),
        ("G43 H1", "G43 cannot be corrected"),
        ("G38.2 Z-600", "G38.2 cannot be corrected"),
        ("G2 X5 Y5 R5", "an arc by its radius R → give its centre by I and J"),
        ("G2 X5 Y5", "an arc without a centre"),
        ("G2 X10 Y0 I4", "the arc begins 4.0000 mm from its centre and ends 6.0000 mm from it"),
        ("G18 G2 X5 I5", "an arc in G18"),
        ("G3 X0 I5 P3", "an arc of several turns (P)"),
        ("G1 G2 X5", "G1 and G2 in one line"),
        ("G4 X2", "G4 with X2"),
        ("G28 Z0", "G28 with Z0"),
        ("G1 X5 E0.3", "E0.3: the robot's axes are X Y Z"),
        ("G1 X5 R1", "R in a straight move"),
        ("G1 X5 X6", "X stands twice in a line"),
        ("G80\nX5", "coordinates after G80"),
        ("M98 P100", "M98 brings other modes back or runs other lines"),
        ("/G1 X5", "a line that may be skipped (/)"),
        ("G1 X#5", "variables, expressions and O-words are not followed"),
        ("G1 X[1+2]", "variables, expressions and O-words are not followed"),
        ("o100 while [#1 LT 5]", "variables, expressions and O-words are not followed"),
        ("SET_PIN PIN=x", "is no word of G-code"),
        ("G1 X1.2.3", "is no word of G-code"),
    ],
)
def test_refused_by_its_line(line, says):
    text = refused(FIRST + line + "\n")
    assert text.startswith(f"part.ngc:{3 + line.count(chr(10))}: ")
    assert says in text
    assert " → " in text


def test_a_file_without_words_is_no_program():
    with pytest.raises(TargetsInvalid, match="holds no G-code"):
        tuple(parse_gcode("; nothing\n\n", "part.ngc"))


WORDS = st.builds(
    lambda letter, number, blank: f"{letter}{blank}{number}",
    st.sampled_from("FfNSTMPQLDH"),
    st.integers(0, 69),
    st.sampled_from(["", " "]),
)
LINES = st.builds(
    lambda words, comment, blank: blank + " ".join(words) + comment,
    st.lists(WORDS, max_size=4, unique_by=lambda word: word[0].upper()),
    st.sampled_from(["", "(a comment)", "; another", " ( two ) (three)"]),
    st.sampled_from(["", " ", "\t"]),
)


@given(st.lists(st.tuples(LINES, st.sampled_from(["\n", "\r\n", "\r"])), max_size=8), LINES)
def test_everything_that_is_no_move_is_the_same_again(lines, last):
    text = "M5\n" + "".join(line + ending for line, ending in lines) + last
    blocks = tuple(parse_gcode(text, "part.ngc"))
    assert "".join(block.text for block in blocks) == text
    assert tuple(moves_of(blocks, "part.ngc", DELTA)) == blocks


@given(st.text(max_size=60))
def test_any_text_is_read_or_refused(text):
    try:
        found = moves(text)
    except TargetsInvalid:
        return
    assert all(math.isfinite(value) for move in found for value in move.end)


def test_a_program_that_is_too_long_is_refused_before_it_is_parsed(tmp_path, monkeypatch):
    monkeypatch.setattr("campaigns.controllers.gcode.MOST_LINES", 3)
    path = tmp_path / "part.ngc"
    path.write_bytes(b"G1\r\nX1\rX2\nno word")
    assert read_program(path).endswith("no word")
    path.write_bytes(b"G1\r\nX1\rX2\nno word\n")
    with pytest.raises(TargetsInvalid, match="has 4 lines, at most 3 are corrected → split"):
        read_program(path)
