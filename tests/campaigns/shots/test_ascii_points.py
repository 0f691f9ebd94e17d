"""Point files of SpatialAnalyzer and OpenIndy: what they mean, and what they cannot tell."""

import math
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st
from refusals import refusal

from campaigns.errors import ShotsInvalid
from campaigns.shots.ascii_points import parse_points, read_points

SPATIAL_ANALYZER = """\
// SpatialAnalyzer, frame: Tracker 1
// X, Y, Z in the working frame

A Main p1 2000.500000 10.250000 -300.125000
A Main p2 2100.000000 20.000000 -310.000000
"""
OPENINDY = """\
# exported points
p1 2.0005 0.01025 -0.300125 shots first
p2 2.1 0.02 -0.31 shots second
"""


def read(text, unit="mm", columns=None):
    return parse_points(text, "points.txt", unit=unit, columns=columns)


def found(text, **told):
    return {point.name: point.point_mm for point in read(text, **told)[0]}


complaint = partial(refusal, ShotsInvalid, read, begins="points.txt:")


class TestForms:
    def test_names_stand_before_and_comments_behind(self):
        assert found(SPATIAL_ANALYZER) == {
            "A::Main::p1": (2000.5, 10.25, -300.125),
            "A::Main::p2": (2100.0, 20.0, -310.0),
        }
        points = found(OPENINDY, unit="m")
        assert points["p1"] == pytest.approx((2000.5, 10.25, -300.125))
        assert list(points) == ["p1", "p2"]
        points = read("1.0 2.0 3.0\n4.0 5.0 6.0\n")[0]
        assert [point.name for point in points] == ["", ""]
        assert points[1].point_mm == (4.0, 5.0, 6.0)

    @pytest.mark.parametrize("joint", [",", ", ", ";", "\t", "   "])
    def test_any_separator_is_understood(self, joint):
        text = SPATIAL_ANALYZER.replace(" ", joint) if joint != "   " else SPATIAL_ANALYZER
        text = "\n".join(line for line in text.splitlines() if not line.startswith("//"))
        assert found(text) == found(SPATIAL_ANALYZER)

    def test_blanks_quotes_and_scientific_numbers_are_read(self):
        text = "Group one, point 1, 1.0, 2.0, 3.0\nGroup one, point 2, 4.0, 5.0, 6.0\n"
        assert list(found(text)) == ["Group one::point 1", "Group one::point 2"]
        assert list(found('"p1",1.0,2.0,3.0\n')) == ["p1"]
        text = "p1 2.0005e+03 1.025E1 -3.00125e+002\n"
        assert found(text)["p1"] == pytest.approx((2000.5, 10.25, -300.125))

    @pytest.mark.parametrize("first", ["1 ", "A 1 ", "A Main 1 "])
    def test_whole_number_before_three_numbers_is_a_name(self, first):
        text = f"{first}2000.5 10.25 -300.0\n{first.replace('1', '2')}2000.5 10.25 -300.0\n"
        names = list(found(text))
        assert [name.rpartition("::")[2] for name in names] == ["1", "2"]

    def test_windows_file_with_comments_anywhere_is_read(self, tmp_path):
        path = tmp_path / "points.txt"
        text = "\ufeff// head\r\np1 1.0 2.0 3.0\r\n; note\r\n\r\n# note\r\np2 4.0 5.0 6.0\r\n"
        path.write_bytes(text.encode())
        points = read_points(path, unit="mm")[0]
        assert [point.where.rpartition(":")[2] for point in points] == ["2", "6"]

    def test_how_it_was_understood_is_told(self):
        assert read(SPATIAL_ANALYZER)[1] == "name, name, name, x, y, z by blanks, in mm"
        assert read("p1;1;2;3\n", unit="inch")[1] == "name, x, y, z by semicolons, in inch"


class TestColumnsThatAreTold:
    def test_numbers_behind_the_point_are_left_alone(self):
        text = "p1 1.0 2.0 3.0 0.01 0.02 0.03\n"
        assert "6 numbers in a row" in complaint(text)
        assert found(text, columns=("name", "x", "y", "z")) == {"p1": (1.0, 2.0, 3.0)}

    def test_columns_told_may_stand_in_another_order_and_name_numbers(self):
        text = "3.0 p1 1.0 9.9 2.0\n"
        assert found(text, columns=("z", "name", "x", "-", "y")) == {"p1": (1.0, 2.0, 3.0)}
        text = "1.5 1.0 2.0 3.0\np2 1.0 2.0 3.0\n"
        told = ("name", "x", "y", "z")
        assert list(found(text, columns=told)) == ["1.5", "p2"]

    @pytest.mark.parametrize(
        ("columns", "said"),
        [
            (("name", "X", "y", "z"), "unknown column 'X' → did you mean x?"),
            (("name", "x", "y"), "have 0 z"),
            (("x", "x", "y", "z"), "have 2 x"),
        ],
    )
    def test_columns_that_cannot_be_are_refused(self, columns, said):
        assert said in complaint("p1 1.0 2.0 3.0\n", columns=columns)

    def test_a_line_too_short_or_with_a_word_for_a_number_is_named(self):
        text = "p1 1.0 2.0 3.0\np2 1.0 2.0\n"
        assert "points.txt:2: 3 words for 4" in complaint(text, columns=("name", "x", "y", "z"))
        said = complaint("p1 1.0 2.0 oops\n", columns=("name", "x", "y", "z"))
        assert "points.txt:1: z is 'oops', must be a number" in said


class TestUnits:
    @pytest.mark.parametrize(("unit", "mm"), [("mm", 1.0), ("m", 1000.0), ("inch", 25.4)])
    def test_point_is_in_mm(self, unit, mm):
        assert found("p1 1.0 2.0 4.0\n", unit=unit)["p1"] == (mm, 2.0 * mm, 4.0 * mm)

    def test_unit_that_nobody_tells_is_never_guessed(self):
        said = complaint(SPATIAL_ANALYZER, unit=None)
        assert said.endswith(
            "does not say its unit of length → give it with --unit mm|m|inch|ft|cm|um"
        )

    def test_point_too_far_away_is_in_another_unit(self):
        said = complaint("p1 200000.5 10.0 -300.0\n", unit="m")
        assert "points.txt:1: x is 200000.5 m, farther than 1e+08 mm → check --unit" in said


class TestComplaints:
    @pytest.mark.parametrize("text", ["", "\n\n", "// only comments\n# here\n"])
    def test_file_without_points_is_refused(self, text):
        assert "holds no points" in complaint(text)

    def test_lines_that_are_not_like_the_first_are_named(self):
        said = complaint("p1 1.0 2.0 3.0\nend of file\n")
        assert "points.txt:2: no X Y Z: 'end of file'" in said
        said = complaint("p1 1.0 2.0 3.0\n\nA p2 1.0 2.0 3.0\n")
        assert "points.txt:3: 'A p2 1.0 2.0 3.0' has other columns than line 1" in said
        assert "commas if names hold blanks" in said

    def test_what_could_be_read_in_two_ways_is_not_guessed(self):
        said = complaint("2000.5 10.0 -300.0 0.02\n")
        assert "4 numbers in a row, X Y Z are three → say what they are" in said
        assert "4 words before X Y Z" in complaint("a b c d 1.0 2.0 3.0\n")

    @pytest.mark.parametrize(
        "line", ["p1 2000,5 10,25 -300,125", "p1;2000,5;10,25;-300,125", "p1\t2,0\t10,2\t-3,1"]
    )
    def test_decimal_commas_are_named(self, line):
        said = complaint(f"{line}\n")
        assert "is a decimal comma → export the points with decimal points" in said

    def test_name_that_stands_twice_is_named_with_both_lines(self):
        said = complaint("p1 1.0 2.0 3.0\np2 1.0 2.0 3.0\np1 4.0 5.0 6.0\n")
        assert "points.txt:3: point 'p1' stands already in line 1" in said

    @pytest.mark.parametrize("word", ["nan", "inf", "1e999", "1,5", "0x10"])
    def test_what_is_no_number_is_no_coordinate(self, word):
        complaint(f"p1 1.0 2.0 3.0\np2 {word} 2.0 3.0\n")

    def test_file_that_is_not_there_is_named(self, tmp_path):
        with pytest.raises(ShotsInvalid, match=r"gone\.txt: there is no such file"):
            read_points(tmp_path / "gone.txt", unit="mm")

    def test_file_that_is_no_text_is_named(self, tmp_path):
        path = tmp_path / "points.txt"
        path.write_bytes(b"p1 1.0 2.0 3.0\n\xff\xfe\n")
        with pytest.raises(ShotsInvalid, match=r"points\.txt:2: byte 0xff is not UTF-8"):
            read_points(path, unit="mm")


coordinates = st.floats(-9e5, 9e5).map(lambda value: round(value, 6))
names = st.text(st.characters(categories=["L"]), min_size=1, max_size=8)
named = st.dictionaries(names, st.tuples(*[coordinates] * 3), min_size=1, max_size=10)


@given(named, st.sampled_from([" ", ",", ";", "\t"]), st.sampled_from(["{:.6f}", "{:.15e}"]))
def test_whatever_is_exported_is_read_again(points, joint, form):
    text = "".join(
        joint.join([name, *map(form.format, point)]) + "\n" for name, point in points.items()
    )
    assert list(found(text)) == list(points)
    for name, point in found(text).items():
        assert point == pytest.approx(points[name], rel=1e-14)


@given(st.text(st.characters(codec="latin-1"), max_size=200))
def test_any_text_is_read_or_refused_in_one_line(text):
    said, points = "", ()
    try:
        points = read(text)[0]
    except ShotsInvalid as error:
        said = str(error)
    assert bool(said) != bool(points)
    assert len(said.splitlines()) <= 1
    assert all(math.isfinite(value) for point in points for value in point.point_mm)
