"""Point files of SpatialAnalyzer and OpenIndy: what they mean, and what they cannot tell."""

import math
import time
from contextlib import suppress
from functools import partial

import pytest
from hypothesis import given
from hypothesis import strategies as st
from refusals import refusal

from campaigns.errors import ShotsInvalid
from campaigns.shots.point_files import data_rows, parse_points, point_of_row, read_points
from campaigns.shots.point_layout import PointFormat

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


def read(text, unit="mm", **form):
    return parse_points(text, "points.txt", PointFormat(unit=unit, **form))


def found(text, **form):
    return {point.name: point.point_mm for point in read(text, **form).points}


def notes(text, **form):
    return "\n".join(read(text, **form).notes)


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
        points = read("1.0 2.0 3.0\n4.0 5.0 6.0\n").points
        assert [point.name for point in points] == ["", ""]
        assert points[1].point_mm == (4.0, 5.0, 6.0)

    def test_names_with_blanks_and_scientific_numbers_are_read(self):
        text = "Group one, point 1, 1.0, 2.0, 3.0\nGroup one, point 2, 4.0, 5.0, 6.0\n"
        assert list(found(text)) == ["Group one::point 1", "Group one::point 2"]
        text = '"p1" 2.0005e+03 1.025E1 -3.00125e+002\n'
        assert found(text)["p1"] == pytest.approx((2000.5, 10.25, -300.125))

    def test_whole_number_before_three_numbers_is_a_name(self):
        assert list(found("A 1 2000.5 10.25 -300.0\nA 2 2000.5 10.25 -300.0\n")) == ["A::1", "A::2"]

    def test_windows_file_with_comments_anywhere_is_read(self, tmp_path):
        path = tmp_path / "points.txt"
        text = "\ufeff// head\r\np1 1.0 2.0 3.0\r\n; note\r\n\r\n# note\r\np2 4.0 5.0 6.0\r\n"
        path.write_bytes(text.encode())
        points = read_points(path, PointFormat(unit="mm")).points
        assert [point.where.rpartition(":")[2] for point in points] == ["2", "6"]


class TestColumnsThatAreTold:
    def test_columns_may_stand_in_any_order_and_be_left_out(self):
        text = "3.0 p1 1.0 9.9 2.0\n"
        assert found(text, columns=("z", "name", "x", "-", "y")) == {"p1": (1.0, 2.0, 3.0)}

    def test_columns_that_cannot_be_are_refused(self):
        text = "p1 1.0 2.0 3.0\np2 1.0 2.0\n"
        said = complaint(text, columns=("name", "X", "y", "z"))
        assert "unknown column 'X' → did you mean x?" in said
        assert "has 0 z" in complaint(text, columns=("name", "x", "y"))
        assert "points.txt:2: 3 words for 4" in complaint(text, columns=("name", "x", "y", "z"))


class TestComplaints:
    def test_unit_that_nobody_tells_is_never_guessed(self):
        said = complaint(SPATIAL_ANALYZER, unit=None)
        assert "does not state its unit of length → give it with --unit mm|m|inch|" in said
        said = complaint("p1 200000.5 10.0 -300.0\n", unit="m")
        assert "points.txt:1: x is 200000.5 m, farther than 1e+08 mm → check --unit" in said

    def test_file_without_points_is_refused(self):
        for text in ("", "// only comments\n# here\n"):
            assert "holds no points" in complaint(text)

    def test_lines_that_are_not_like_the_first_are_named(self):
        said = complaint("p1 1.0 2.0 3.0\nend of file\n")
        assert "points.txt:2: no X Y Z: 'end of file'" in said
        said = complaint("p1 1.0 2.0 3.0\n\nA p2 1.0 2.0 3.0\n")
        assert "points.txt:3: 'A p2 1.0 2.0 3.0' has other columns than line 1" in said
        assert "commas if names hold blanks" in said

    def test_what_could_be_read_in_two_ways_is_not_guessed(self):
        text = "p1 1.0 2.0 3.0 0.01\n"
        assert "4 numbers in a row, X Y Z are three → name the columns" in complaint(text)
        assert found(text, columns=("name", "x", "y", "z")) == {"p1": (1.0, 2.0, 3.0)}
        assert "4 words before X Y Z" in complaint("a b c d 1.0 2.0 3.0\n")

    def test_name_that_stands_twice_is_named_with_both_lines(self):
        said = complaint("p1 1.0 2.0 3.0\np2 1.0 2.0 3.0\np1 4.0 5.0 6.0\n")
        assert "points.txt:3: point 'p1' stands already in line 1" in said

    @pytest.mark.parametrize("word", ["nan", "1e999", "0x10"])
    def test_what_is_no_number_is_no_coordinate(self, word):
        complaint(f"p1 1.0 2.0 3.0\np2 {word} 2.0 3.0\n")


class TestHeaders:
    @pytest.mark.parametrize(
        ("header", "row"),
        [
            ("sep=;\nName;X;Y;Z", "p1;1;2;3"),
            ("Report of 3 points\n\nName  X [mm]  Y [mm]  Z [mm]", "p1 1 2 3"),
            ("Point Name,Y,X,Z,Comment", "p1,2,1,3,4"),
            ("Name;X;Y;Z\n;[mm];[mm];[mm]", "p1;1;2;3"),
            ("Name,dX,dY,dZ,X,Y,Z", "p1,0.1,0.2,0.3,1,2,3"),
            ("# Name Z Y X", "p1 3 2 1"),
            ("Punkt;coordX;coordY;coordZ", "p1;1;2;3"),
            ("Target,Id,X,Y,Z", "CCR 1.5,p1,1,2,3"),
        ],
    )
    def test_header_lines_determine_the_columns_and_are_noted(self, header, row):
        assert found(f"{header}\n{row}\n") == {"p1": (1.0, 2.0, 3.0)}
        count = len([*filter(None, header.splitlines())])
        quoted = notes(f"{header}\n{row}\n")
        assert f"{count} header line{'s' if count > 1 else ''} skipped: '" in quoted

    @pytest.mark.parametrize(
        ("unit", "mm"),
        [
            *(("(m)", 1e3), ("_inch", 25.4), (" in", 25.4), (" [µm]", 1e-3), ("[ft]", 304.8)),
            *((" [Meters]", 1e3), (" in mm", 1.0), (", in", 25.4), (";in", 25.4)),
        ],
    )
    def test_header_states_the_unit(self, unit, mm):
        text = f"Name;X{unit};Y{unit};Z{unit}\np1;1;2;4\n"
        assert found(text, unit=None)["p1"] == pytest.approx((mm, 2.0 * mm, 4.0 * mm))

    @pytest.mark.parametrize(
        ("line", "mm"), [("// Unit = in", 25.4), ("Length units: mm, Angles: Degrees", 1.0)]
    )
    def test_line_above_states_the_unit(self, line, mm):
        for header in ("Name;X;Y;Z\n", ""):
            assert found(f"{line}\n{header}p1;1;2;4\n", unit=None)["p1"] == (mm, 2 * mm, 4 * mm)

    def test_line_above_that_states_several_units_is_not_used(self):
        assert "does not state its unit" in complaint("Units: mm, σ: um\np1;1;2;4\n", unit=None)

    def test_columns_given_go_before_those_of_the_header(self):
        text = "Name X Y Z Time\nleft nest 1 2 3 27.11.2026 21:10:02\n"
        assert "7 values for 5 columns of the header → " in complaint(text)
        columns = ("name", "name", "x", "y", "z")
        assert found(text, columns=columns) == {"left::nest": (1.0, 2.0, 3.0)}

    def test_unit_given_goes_before_the_headers_and_is_noted(self):
        text = "Name;X [mm];Y [mm];Z [mm]\np1;1;2;4\n"
        assert found(text, unit="m")["p1"] == (1000.0, 2000.0, 4000.0)
        assert "the header states mm, --unit m is used" in notes(text, unit="m")

    @pytest.mark.parametrize(
        ("header", "said"),
        [
            ("Name;X [furlong];Y [furlong];Z [furlong]", "'furlong' beside X Y Z in the header"),
            ("Name;X [mm];Y [mm];Z [m]", "the header has several units: mm, mm, m"),
            ("Name;X;Y;Z;X;Y;Z", "the header has two columns 'X' → choose with --columns"),
            ("Name;X nom;Y nom;Z nom", "names nominal coordinates only"),
            ("Name;dX;dY;dZ", "'d' beside X Y Z in the header is no known unit"),
            ("Units: in\nName;X [mm];Y [mm];Z [mm]", "in mm, a line above states inch"),
        ],
    )
    def test_header_that_cannot_be_read_is_refused(self, header, said):
        assert said in complaint(f"{header}\np1;1;2;3;4;5;6\n", unit=None)

    @pytest.mark.parametrize("header", ["Name;R;Theta;Z", "id;DX;DY;DZ"])
    def test_columns_of_other_names_are_never_taken_for_x_y_z(self, header):
        said = complaint(f"{header}\np1;1;2;3\n")
        assert f"points.txt:1: the header '{header}' does not name X, Y and Z → name the" in said

    def test_title_that_reads_as_a_point_is_named(self):
        said = complaint("Report 2026 11 27\nName X Y Z\np1 1 2 3\n")
        assert "points.txt:1: 'Report 2026 11 27' reads as a point above the header line" in said

    def test_of_two_sets_one_is_chosen(self):
        text = "Name;X nom;Y nom;Z nom;X act;Y act;Z act\np1;1;2;3;4;5;6\n"
        said = complaint(text)
        assert "points.txt:1: the header has 2 sets of X Y Z, 'X nom' and 'X act'" in said
        assert "→ choose with --coordinates actual or nominal" in said
        assert found(text, coordinates="actual")["p1"] == (4.0, 5.0, 6.0)
        assert found(text, coordinates="nominal")["p1"] == (1.0, 2.0, 3.0)
        assert found(text, columns=("name", "-", "-", "-", "x", "y", "z"))["p1"] == (4.0, 5.0, 6.0)
        half = text.replace(" act", "")
        assert found(half, coordinates="actual")["p1"] == (4.0, 5.0, 6.0)

    def test_uncertainties_become_covariances_and_times_are_read(self):
        head = "X [m],Y [m],Z [m],U(95) [mm],U(95) X [mm],U(95) Y [mm],U(95) Z [mm],Time Stamp\n"
        text = f"{head}1,2,3,9,0.02,0.04,0.06,'11.10.2022 15:06:00.043\n"
        (point,) = read(text, unit=None).points
        assert point.point_mm == (1000.0, 2000.0, 3000.0)
        assert [point.covariance_mm2[i][i] for i in range(3)] == pytest.approx([1e-4, 4e-4, 9e-4])
        assert point.time == "2022-10-11T15:06:00.043000"
        (point,) = read("x,y,z,sx,sy,sz,time\n1,2,3,.1,.1,.1,7.5\n").points
        assert point.covariance_mm2[0][0] == pytest.approx(0.01)
        assert point.time == "7.5"

    @pytest.mark.parametrize(
        ("heading", "std"),
        [("ux;uy;uz", 0.1), ("Ux;Uy;Uz", 0.05), ("StdDev X;StdDev Y;StdDev Z", 0.1)],
    )
    def test_small_u_is_one_sigma_and_large_u_two(self, heading, std):
        (point,) = read(f"X;Y;Z;{heading}\n1;2;3;.1;.1;.1\n").points
        assert point.covariance_mm2[0][0] == pytest.approx(std**2)

    def test_uncertainties_in_other_words_are_not_used(self):
        text = "X;Y;Z;2σ X;2σ Y;2σ Z\n1;2;3;.1;.1;.1\n"
        assert read(text).points[0].covariance_mm2 is None
        assert "not used: '2σ X'" in notes(text)

    def test_uncertainty_of_zero_and_time_that_cannot_be_read_are_noted(self):
        text = "x,y,z,σx,σy,σz,time\n1,2,3,.1,.1,.1,7\n1,2,4,.1,-.1,.1,noon\n"
        points, said = read(text).points, read(text).notes
        assert [point.covariance_mm2 for point in points] == [None, None]
        assert [point.time for point in points] == [None, None]
        assert any("points.txt:3: an uncertainty is not above zero" in note for note in said)
        assert any("points.txt:3: time 'noon' cannot be read" in note for note in said)

    @pytest.mark.parametrize(
        ("rows", "std"),
        [
            ("1;2;3;.012;0;.013", 0.0005),
            ("1;2;3;0.00;0.02;0.03", 0.005),
            ("1;2;3;1;0;2\n4;5;6;1.5;1;1", 0.05),
        ],
    )
    def test_uncertainty_printed_as_zero_is_half_of_the_last_digit(self, rows, std):
        text = f"X;Y;Z;σX;σY;σZ\n{rows}\n"
        point = read(text).points[0]
        assert min(point.covariance_mm2[i][i] for i in range(3)) == pytest.approx(std**2)
        said = f"points.txt: 1 uncertainty of 0 is taken as half of a last digit, {std:g} mm"
        assert said in notes(text)

    @pytest.mark.parametrize("rows", ["1;2;3;0.000;0.000;0.000", "1;2;3;5;0;5"])
    def test_a_row_of_zeros_and_a_zero_without_decimals_state_no_uncertainty(self, rows):
        text = f"X;Y;Z;σX;σY;σZ\n{rows}\n"
        assert read(text).points[0].covariance_mm2 is None
        assert "an uncertainty is not above zero: none of them is used" in notes(text)

    @pytest.mark.parametrize(
        "header",
        [
            "Punkt;X-Koordinate [mm];Y-Koordinate [mm];Z-Koordinate [mm]",
            "nom;X mesuré (mm);Y mesuré (mm);Z mesuré (mm)",
            "field.name;field.point.x_mm;field.point.y_mm;field.point.z_mm",
            "点;X坐标(mm);Y坐标(mm);Z坐标(mm)",
            "Name;Spalte x mm;Spalte y mm;Spalte z mm",
        ],
    )
    def test_headings_alike_but_for_the_axis_are_coordinates_in_any_language(self, header):
        points = read(f"{header}\np1;1;2;3\np2;4;5;6\n", unit=None)
        assert [point.point_mm for point in points.points] == [(1.0, 2.0, 3.0), (4.0, 5.0, 6.0)]
        assert points.unit == "mm"

    @pytest.mark.parametrize(
        "header",
        [
            "Name;RotX;RotY;RotZ",
            "Name;X alt;Y alt;Z alt;X neu;Y neu;Z neu",
            "Name;X [furlong];Y [furlong];Z [furlong]",
        ],
    )
    def test_alike_headings_of_other_quantities_or_of_several_sets_are_refused(self, header):
        row = ";".join(["p1", *map(str, range(header.count(";")))])
        assert "points.txt:1: " in complaint(f"{header}\n{row}\n")

    def test_beside_a_set_that_is_understood_no_other_counts(self):
        text = "Name;X;Y;Z;Abweichung X;Abweichung Y;Abweichung Z\np1;1;2;3;4;5;6\n"
        assert found(text)["p1"] == (1.0, 2.0, 3.0)

    def test_of_sets_in_an_unknown_language_the_measured_one_is_chosen(self):
        header = ";".join(f"{axis} Wert {kind}" for kind in ("Soll", "Ist") for axis in "XYZ")
        text = f"Name;{header}\np1;1;2;3;4;5;6"
        assert found(text, coordinates="actual")["p1"] == (4.0, 5.0, 6.0)
        assert "--coordinates actual or nominal" in complaint(text)

    @pytest.mark.parametrize(
        "line",
        [
            "Cnt=1  X= 2081.434 Y=  156.993 Z= -892.511 RotX=    1.530",
            "x=2081.434,y=156.993,z=-892.511",
            "X: 2081.434; Y: 156.993; Z: -8.92511e+02",
            "name=P1 X=2081.434 Y=156.993 Z=-892.511 at=12:30",
        ],
    )
    def test_words_before_values_are_the_header(self, line):
        points = read(f"Pos 1\n{line}\n{line.replace('Cnt=1', 'Cnt=2').replace('P1', 'P2')}\n")
        assert {point.point_mm for point in points.points} == {(2081.434, 156.993, -892.511)}
        assert len(points.points) == 2

    @pytest.mark.parametrize(
        ("line", "name"),
        [
            ("P1 X=2081,434 Y=156,993 Z=-892,511", "P1"),
            ("P1: X = 2081.434, Y = 156.993, Z = -892.511", "P1"),
            ("P1 {X 2081.434,Y 156.993,Z -892.511,A 0.0,B 0.0,C 0.0}", "P1"),
            ("N1 X2081.434 Y156.993 Z-892.511", "N1"),
            ("G1 X2081.434 Y156.993 Z-892.511", ""),
            ("{X 2081.434, Y 156.993, Z -892.511}", ""),
            ("name=P1 x=2081,434 y=156,993 z=-892,511", "P1"),
        ],
    )
    def test_what_stands_before_the_axes_is_the_name_if_it_differs(self, line, name):
        other = line.replace("P1", "P2").replace("N1", "N2").replace("892", "893")
        points = read(f"{line}\n{other}\n").points
        assert points[0].point_mm == (2081.434, 156.993, -892.511)
        assert [point.name for point in points] == [name, name.replace("1", "2")]

    @pytest.mark.parametrize("piece", ["a", "x", "1", "a= ", "x1,1.", "a=b:", "a  "])
    def test_a_long_line_takes_no_long_time(self, piece):
        begun = time.process_time()
        with suppress(ShotsInvalid):
            read(f"X=1 Y=2 Z=3\n{piece * (90_000 // len(piece))}\n")
        assert time.process_time() - begun < 2.0

    def test_rows_of_other_words_are_named(self):
        said = complaint("X=1 Y=2 Z=3\nX=1 Y=2\n")
        assert said.startswith("points.txt:2: ")


class TestNotations:
    UNCLEAR = (
        "p1;510,012;-35,487;-75,125",
        '"p1","927,032","101,267","425,832"',
        "p1;2000,5;1.25;3",
        "p1;510,012;1.5;3",
        "p1 510,112 135,487 175,302",
    )

    @pytest.mark.parametrize("line", UNCLEAR)
    def test_commas_that_may_be_two_things_are_refused_unless_the_decimal_sign_is_given(self, line):
        said = complaint(f"// export\n{line}\n")
        assert "points.txt:2: x is '" in said
        assert "with a decimal comma or a thousands separator → give --decimal comma" in said

    @pytest.mark.parametrize("sure", ["-0,125", "12,5", "1234,567", "1.234,5", "1,5e+3"])
    @pytest.mark.parametrize("mark", [";", "\t", "  "])
    def test_a_row_that_is_clear_decides_for_all_others(self, sure, mark):
        rows = (("p1", "510,112", "35,487", "175,302"), ("p2", sure, "1", "-2"))
        read_in = read("".join(f"{mark.join(row)}\n" for row in rows))
        assert read_in.points[0].point_mm == (510.112, 35.487, 175.302)
        assert read_in.points[1].point_mm[1:] == (1.0, -2.0)
        assert "in mm, with decimal commas" in read_in.notes[0]

    @pytest.mark.parametrize("name", ["", "p1 ", "1 "])
    def test_blanks_are_the_borders_where_commas_would_leave_them_in_numbers(self, name):
        points = read(f"{name}510,112 135,487 175,302\n", decimal="comma").points
        assert points[0].point_mm == (510.112, 135.487, 175.302)

    @pytest.mark.parametrize(
        ("line", "point"),
        [
            ('p1,"1,510.012","1,000",-75.5', (1510.012, 1000.0, -75.5)),
            ("p1;1’510.012;1’000;-75.5", (1510.012, 1000.0, -75.5)),
            ("p1\t1 510.012\t1 000\t-75.5", (1510.012, 1000.0, -75.5)),
            ("p1;1,234,567.5;12,000;3", (1234567.5, 12000.0, 3.0)),
            ("p1;1.510,25;2.000;-0,5", (1510.25, 2000.0, -0.5)),
        ],
    )
    def test_thousands_are_read_where_a_number_shows_how_they_are_grouped(self, line, point):
        text = f"name{line[2]}x{line[2]}y{line[2]}z\n{line}\n"
        assert found(text)["p1"] == point
        assert "thousands are grouped: '1" in notes(text)

    @pytest.mark.parametrize("lines", ["x;y;z\n510,012;135,487;1\n12,5;1;2\n", "12,5;1;2\n"])
    def test_a_growing_file_decides_by_all_its_rows(self, lines):
        rows = data_rows(f"{lines}310,125;2;3\n")
        form = PointFormat(unit="mm", option="tracker.watch.")
        text = f"{lines}310,125;2;3\n"
        assert point_of_row(rows[-1], text, "f", form) == (310.125, 2.0, 3.0)
        with pytest.raises(ShotsInvalid, match=r"tracker\.watch\.decimal comma"):
            point_of_row(rows[-1], "310,125;2;3\n", "f", form)

    @pytest.mark.parametrize(
        ("line", "decimal", "point"),
        [
            ("p1 2000,5 10,25 -300,125", "comma", (2000.5, 10.25, -300.125)),
            ("p1;2.927,032;1.000.000;-1", "comma", (2927.032, 1e6, -1.0)),
            ("p1;2'927.032;1 000;-1.5", "point", (2927.032, 1000.0, -1.5)),
        ],
    )
    def test_decimal_sign_given_is_used(self, line, decimal, point):
        assert found(f"{line}\n", decimal=decimal)["p1"] == point

    @pytest.mark.parametrize(
        "line", ["p1 \N{MINUS SIGN}2.5 30 1.5", "p1;-2.5;3.0D+01;15D-01", '"p1","-2.5","30","1.5"']
    )
    def test_signs_of_other_programs_are_read(self, line):
        assert found(f"{line}\n")["p1"] == (-2.5, 30.0, 1.5)

    def test_number_of_the_other_notation_is_refused(self):
        assert "x is '2000.5'" in complaint("p1;2000.5;1,5;2,5\n", decimal="comma")
        assert "x is '2.927,032'" in complaint("p1;2.927,032;1.5;2.5\n", decimal="point")

    def test_thousands_separator_is_no_part_of_a_name(self):
        text = "p1,2,927.032,267.835,-425.832\np2,2,678.052,676.534,-371.112\n"
        assert "'2,927.032' may be a number with a thousands separator" in complaint(text)
        assert "'2 927.032' may be a number" in complaint("p1 2 927.032 267.835 -425.832\n")


class TestEncodings:
    TEXT = "Name;X [µm];Y [µm];Z [µm]\r\nHöhe;1000;2000;3000\r\n"

    @pytest.mark.parametrize(
        ("codec", "encoding"),
        [*(("utf-8-sig", None), ("utf-16", None), ("cp1252", "cp1252")), ("utf-16-be", "utf-16")],
    )
    def test_byte_order_mark_or_option_decides(self, tmp_path, codec, encoding):
        path = tmp_path / "points.txt"
        path.write_bytes(self.TEXT.encode(codec))
        (point,) = read_points(path, PointFormat(encoding=encoding)).points
        assert (point.name, point.point_mm) == ("Höhe", (1.0, 2.0, 3.0))

    def test_bytes_that_are_not_utf_8_are_named_with_the_option(self, tmp_path):
        path = tmp_path / "points.txt"
        path.write_bytes(self.TEXT.encode("cp1252"))
        said = r"points\.txt:1: byte 0xb5 is not UTF-8 text → give --encoding utf-8\|utf-16\|cp1252"
        with pytest.raises(ShotsInvalid, match=said):
            read_points(path, PointFormat())
        path.write_bytes(b"Name;X [mm]\n".decode().encode("utf-16-le"))
        with pytest.raises(ShotsInvalid, match=r"points\.txt:1: has NUL .* give --encoding utf-8"):
            read_points(path, PointFormat())


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
        points = read(text).points
    except ShotsInvalid as error:
        said = str(error)
    assert bool(said) != bool(points)
    assert len(said.splitlines()) <= 1
    assert all(math.isfinite(value) for point in points for value in point.point_mm)
