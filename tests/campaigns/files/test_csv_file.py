"""CSV: what a spreadsheet would calculate is marked as text, and comes back as it was."""

import csv
import io
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from campaigns.errors import ShotsInvalid
from campaigns.files.csv_file import (
    MOST_LINES,
    CsvColumn,
    CsvForm,
    csv_text,
    number_column,
    number_text,
    parse_csv,
    spreadsheet_text,
    whole_column,
)

FORM = CsvForm((CsvColumn("a", required=True), CsvColumn("b", required=True)), ShotsInvalid)
MEASURED = CsvForm(
    (whole_column("shot", required=True), number_column("x_mm", required=True), CsvColumn("set")),
    ShotsInvalid,
)
FILE = "shot,x_mm,set\n1,2000.5,drift\n2,30,\n"
FORMULAS = ("=1+1", "+cmd|' /C calc'!A0", "-x", "@SUM(A1)", "'=1", "''-x", "'", "'a", "=", "-")


def raw(text):
    return list(csv.reader(io.StringIO(text)))[1:]


def there_and_back(*texts):
    written = csv_text(("a", "b"), [texts])
    (row,) = parse_csv(written, "f.csv", FORM)
    return written, (row.text("a"), row.text("b"))


@pytest.mark.parametrize("text", FORMULAS)
def test_a_text_like_a_formula_is_written_as_text_and_read_as_it_was(text):
    written, back = there_and_back(text, "plain")
    assert raw(written)[0][0][0] not in "=+-@"
    assert back == (text, "plain")


def numbers(text):
    return [row.values(("shot", "x_mm")) for row in parse_csv(text, "f", MEASURED)]


@pytest.mark.parametrize(
    ("old", "new", "line", "words"),
    [
        ("x_mm,", "", 1, "column x_mm is missing → the first line must name shot,x_mm"),
        ("x_mm", "x_m", 1, "unknown column 'x_m' → write x_mm, with the value in mm"),
        ("x_mm", ",x_mm", 1, "column 2 has no name"),
        ("set", "shot", 1, "column shot stands twice"),
        ("2000.5", "none", 2, "x_mm is 'none', must be a number"),
        ("2000.5", "1e999", 2, "x_mm is '1e999', must be a number"),
        ("2000.5", "٢٠٠٠", 2, "must be a number"),
        ("2,30", '2,"3,5"', 3, "x_mm is '3,5', a decimal comma → write decimal points"),
        ("2000.5,drift\n2,30", '"2,500",\n2,"3,000"', 2, "x_mm is '2,500', a decimal comma"),
        ("2000.5", "2000,5", 2, "4 values for 3 columns: perhaps decimal commas"),
        ("2000.5", "", 2, "x_mm is empty"),
        ("2000.5", '"2000.5', 2, "is not CSV"),
        ("shot,x_mm,set\n1,2000.5", "\n\nshot,x_mm,set\n1,x", 4, "x_mm is 'x'"),
        ("2,30", "2.5,30", 3, "shot is '2.5', must be a whole number from 0"),
        ("2,30", "9" * 5000 + ",30", 3, "must be a whole number"),
        (FILE, "", 1, "the file is empty"),
        (
            "shot,x_mm,set\n",
            "",
            1,
            "there is no header, the first line holds numbers → write set,s",
        ),
        ("shot,x_mm,set\n1,2000.5,drift\n2,30,", "1,2\n3,4", 1, "write shot,x_mm above it"),
    ],
)
def test_what_is_wrong_is_answered_with_its_line_and_what_to_do(old, new, line, words):
    assert numbers(FILE) == [(1, 2000.5), (2, 30.0)]
    with pytest.raises(ShotsInvalid) as caught:
        numbers(FILE.replace(old, new, 1))
    said = str(caught.value)
    assert said.startswith(f"f:{line}: ")
    assert words in said
    assert " → " in said
    assert len(said) < 250


@pytest.mark.parametrize(
    "text",
    [
        FILE.replace(",", ";"),
        FILE.replace(",", "\t").replace(".", ","),
        FILE.replace("2000.5", '"2000,5"'),
        "sep=;\n" + FILE.replace(",", ";").replace(".", ","),
        FILE.replace("2000.5", '"2.000,5"'),
        FILE.replace(",drift", ",drift,,").replace("set", "set,,"),
        "# measured by hand\n// again\n" + FILE,
        "# " + FILE,
        FILE.replace("shot,x_mm", "Shot,X [mm]"),
        ",shot,x_mm,set\n0,1,2000.5,drift\n1,2,30,\n",
        FILE + FILE,
        FILE.replace("1,2000", "1.0,2000").replace("30", "3.0D+01"),
        "Shots of cell 7; measured by A. B., 2 h\n\n" + FILE,
        "Cell;7;\n" + FILE.replace(",", ";").replace(".", ","),
        "% shots of 2026\n! twice\n" + FILE,
        FILE.replace("\n2,", "\n# by hand, again\n2,") + "// end\n",
        FILE.replace("\n2,", "\n# 1,2000.5,drift\n2,"),
        "No.,shot,x_mm,set\n1,1,2000.5,drift\n2,2,30,\n",
        "Unnamed: 0;shot;x_mm;set\n0;1;2000,5;drift\n1;2;30;\n",
        FILE.replace("set\n", "set\n-,mm,\n"),
        FILE.replace("x_mm", "X").replace("set\n", "set\n,[mm],-\n").replace("X", "x_mm"),
        FILE.replace("x_mm", "x (millimetres)"),
        FILE.replace("1,2000.5", '1, "2000,5"'),
        "shot x_mm\n1  2000.5\n2 \N{MINUS SIGN}30\n".replace("\N{MINUS SIGN}30", "30°"),
    ],
)
def test_form_is_recognised_whoever_wrote_it(text):
    assert numbers(text)[:2] == [(1, 2000.5), (2, 30.0)]


@pytest.mark.parametrize(
    ("text", "where", "words"),
    [
        ("1,2000.5,drift\n" + FILE, 1, "reads as a row above the line that names the columns"),
        (FILE.replace("set\n", "set\n-,inch,\n"), 2, "shot is '-', must be a whole number"),
        ("Cell 7\n" + FILE.replace("x_mm", "x_m"), 2, "unknown column 'x_m'"),
        ("time,shot,x_mm\n0,1,2\n10,2,3\n20,3,4\n", 1, "unknown column 'time'"),
        (FILE.replace("2,30,", "# 2,30,drift,9"), None, ""),
    ],
)
def test_what_is_no_title_no_unit_and_no_index_is_not_passed_over(text, where, words):
    if where is None:
        assert numbers(text) == [(1, 2000.5)]
        return
    with pytest.raises(ShotsInvalid, match=f"^f:{where}: {words}"):
        numbers(text)


JOINTS = CsvForm(
    (CsvColumn("name"), *(number_column(f"q{n}_deg", required=True) for n in range(3))),
    ShotsInvalid,
    numbered=("q0_deg", "q1_deg", "q2_deg"),
)


@pytest.mark.parametrize(
    "header",
    [
        "name,q1,q2,q3",
        "name,J1,J2,J3",
        "name,q1_deg,q2_deg,q3_deg",
        "Name,Joint 1 [deg],Joint 2 [deg],Joint 3 [deg]",
        ",q0_deg,q1_deg,q2_deg",
        "name,q0 (degrees),q1 (degrees),q2 (degrees)",
        "name,q0 [°],q1 °,Q2_°",
        "name,q0,q1,q2",
    ],
)
def test_columns_alike_but_for_a_number_are_the_numbered_ones_in_their_order(header):
    (row,) = parse_csv(f"{header}\nP1,1.5,2.5,-3.5\n", "f", JOINTS)
    assert (row.text("name"), *row.values(JOINTS.numbered)) == ("P1", 1.5, 2.5, -3.5)
    order = [header.split(",")[place] for place in (0, 3, 1, 2)]
    (row,) = parse_csv(f"{','.join(order)}\nP1,-3.5,1.5,2.5\n", "f", JOINTS)
    assert row.values(JOINTS.numbered) == (1.5, 2.5, -3.5)


def test_names_may_begin_as_comments_do():
    text = "name,q0_deg,q1_deg,q2_deg\n#1,1,2,3\n# 2,1,2,3\n#3,1\n"
    assert [row.text("name") for row in parse_csv(text, "f", JOINTS)] == ["#1"]


@pytest.mark.parametrize("header", ["no.,J1,J2,J3", "index;J1;J2;J3", "Unnamed: 0\tq1\tq2\tq3"])
def test_an_index_is_the_name_of_rows_without_another(header):
    mark = header[-3]
    rows = f"{mark.join(['1', '1.5', '2', '3'])}\n{mark.join(['2', '4', '5', '6'])}\n"
    read = [*parse_csv(f"{header}\n{rows}", "f", JOINTS)]
    assert [row.text("name") for row in read] == ["1", "2"]
    assert read[1].values(JOINTS.numbered) == (4.0, 5.0, 6.0)


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ("name,q1_rad,q2_rad,q3_rad", "unknown column 'q1_rad'"),
        ("name,q1,q2,q4", "unknown column 'q1'"),
        ("name,q1_deg,q2_deg,q3", "'q3' → the joints are counted from 0 here: q0_deg, q1_deg, q2"),
    ],
)
def test_columns_in_another_unit_or_not_in_a_row_are_refused(header, words):
    with pytest.raises(ShotsInvalid, match=words):
        list(parse_csv(f"{header}\nP1,1,2,3\n", "f", JOINTS))


def test_negative_numbers_are_no_formulas():
    written, back = there_and_back(number_text(-2.5e17), "-17")
    assert raw(written) == [["-2.5e+17", "-17"]] == [list(back)]


@given(st.text(st.sampled_from("'=+-@ 1.x\",\n\r\t"), max_size=8))
def test_any_text_comes_back_but_for_its_outer_blanks_and_line_breaks(text):
    _, back = there_and_back(text, "x")
    assert back[0] == " ".join(text.strip().splitlines())


@pytest.mark.parametrize("end", ["\n", "\r"])
def test_more_lines_than_any_campaign_has_are_refused_before_they_are_read(end):
    text = "a,b" + (end + "1,2") * 1_000_000
    began_s = time.process_time()
    with pytest.raises(ShotsInvalid, match=f"more than {MOST_LINES} lines"):
        list(parse_csv(text, "f.csv", FORM))
    assert time.process_time() - began_s < 0.5


def test_a_line_longer_than_any_instrument_writes_is_refused_with_its_number():
    text = "a,b\n" + "1," * 1_000_000
    with pytest.raises(ShotsInvalid, match=r"f\.csv:2: has 2000000 characters"):
        list(parse_csv(text, "f.csv", FORM))


@given(st.lists(st.tuples(st.integers(0, 99), st.floats(-1e6, 1e6), st.sampled_from(FORMULAS))))
def test_a_file_for_spreadsheets_with_decimal_commas_comes_back(rows):
    # a number that a comma cuts into groups alone is unclear without others: one is there for sure
    rows = [(0, 0.5, "a;b"), *rows]
    text = MEASURED.text([dict(zip(("shot", "x_mm", "set"), row, strict=True)) for row in rows])
    written = spreadsheet_text(text).encode()
    assert written.startswith(b'\xef\xbb\xbfshot;x_mm;set\n0;0,5;"a;b"\n')
    back = parse_csv(written.decode("utf-8-sig"), "f", MEASURED)
    assert [(*row.values(("shot", "x_mm")), row.text("set")) for row in back] == rows


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ("-2.5e-05", "-2,5e-05"),
        ("p1.2.3", "p1.2.3"),
        ("2026-03-02T09:15:00.5", "2026-03-02T09:15:00.5"),
        ("'=1.5", "'=1.5"),
    ],
)
def test_only_numbers_get_decimal_commas(text, written):
    assert spreadsheet_text(f"a,b\n{text},x\n") == f"\ufeffa;b\n{written};x\n"


@pytest.mark.parametrize("piece", ["a,", "a1,", "a;b ", "1,", "shot,", " ", "a ", "J", "a- "])
def test_lines_of_anything_take_no_long_time(piece):
    begun = time.process_time()
    with pytest.raises(ShotsInvalid):
        numbers((piece * (90_000 // len(piece)) + "\n") * 5)
    assert time.process_time() - begun < 6.0
