"""CSV: what a spreadsheet would calculate is marked as text, and comes back as it was."""

import csv
import io
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from campaigns.errors import ShotsInvalid
from campaigns.files.csv_file import MOST_LINES, CsvForm, csv_text, number_text, parse_csv

FORM = CsvForm(("a", "b"), (), ShotsInvalid)
FORMULAS = ("=1+1", "+cmd|' /C calc'!A0", "-x", "@SUM(A1)", "'=1", "''-x", "'", "'a", "=", "-")


def raw(text):
    return list(csv.reader(io.StringIO(text)))[1:]


def there_and_back(*texts):
    written = csv_text(FORM.columns, [texts])
    (row,) = parse_csv(written, "f.csv", FORM)
    return written, (row.text("a"), row.text("b"))


@pytest.mark.parametrize("text", FORMULAS)
def test_a_text_like_a_formula_is_written_as_text_and_read_as_it_was(text):
    written, back = there_and_back(text, "plain")
    assert raw(written)[0][0][0] not in "=+-@"
    assert back == (text, "plain")


@pytest.mark.parametrize("value", [-1.0, 1e-300, -2.5e17, 0.0])
def test_numbers_are_written_as_they_are(value):
    written, back = there_and_back(number_text(value), "-17")
    assert raw(written) == [[number_text(value), "-17"]] == [list(back)]


@given(st.text(st.sampled_from("'=+-@ 1.x\",\n\r\t"), max_size=8))
def test_any_text_comes_back_but_for_its_outer_blanks_and_line_breaks(text):
    _, back = there_and_back(text, "x")
    assert back[0] == " ".join(text.strip().splitlines())


@pytest.mark.parametrize("end", ["\n", "\r", "\r\n"])
def test_more_lines_than_any_campaign_has_are_refused_before_they_are_read(end):
    text = "a,b" + (end + "1,2") * 1_000_000
    began_s = time.process_time()
    with pytest.raises(ShotsInvalid, match=f"more than {MOST_LINES} lines"):
        list(parse_csv(text, "f.csv", FORM))
    assert time.process_time() - began_s < 0.5
