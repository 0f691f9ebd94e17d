"""Times that other software and spreadsheets write: read in one way, or not at all."""

import pytest

from campaigns.shots.time_texts import is_time, iso_times

FIRST = "2026-10-25T02:59:10"


@pytest.mark.parametrize(
    "text",
    [
        "2026-10-25 02:59:10",
        "25.10.2026 02:59:10",
        "25.10.26, 2:59:10",
        "25/10/2026 02:59:10",
        "25-10-2026T02:59:10",
        "10/25/2026 2:59:10 AM",
        "10/25/26 02:59:10",
        "2026/10/25 02:59:10",
    ],
)
def test_times_of_other_software_become_iso_8601(text):
    assert iso_times([text]) == [FIRST]


@pytest.mark.parametrize(
    ("text", "time"),
    [
        ("25.10.2026 02:59", "2026-10-25T02:59:00"),
        ("25.10.2026 02:59:10,5", "2026-10-25T02:59:10.500000"),
        ("10/25/2026 12:05 AM", "2026-10-25T00:05:00"),
        ("10/25/2026 1:05:00 p.m.", "2026-10-25T13:05:00"),
        ("12.5", "12.5"),
        ("02:59:10", None),
        ("31.2.2026 10:00", None),
        ("", None),
        ("10/11/2026 10:00", None),
        ("11/10/2026 10:00 AM", "2026-11-10T10:00:00"),
    ],
)
def test_a_time_is_read_in_one_way_or_not_at_all(text, time):
    assert iso_times([text]) == [time]


def test_one_date_decides_for_all_and_else_the_order_of_rows():
    assert iso_times(["01/02/2026 10:00", "13/02/2026 10:00"])[0] == "2026-02-01T10:00:00"
    assert iso_times(["01/02/2026 10:00", "02/13/2026 10:00"])[0] == "2026-01-02T10:00:00"
    rows = ["30/11/2026 10:00", "01/12/2026 09:00"]
    assert iso_times(rows) == ["2026-11-30T10:00:00", "2026-12-01T09:00:00"]
    # as months first, the second row would be eleven months earlier
    rows = ["12/11/2026 10:00", "01/12/2026 09:00"]
    assert iso_times(rows) == ["2026-11-12T10:00:00", "2026-12-01T09:00:00"]
    assert iso_times(["01/02/2026 10:00", "01/02/2026 11:00"]) == [None, None]


def test_only_foreign_times_are_no_times():
    assert [is_time(text) for text in ("1.5", FIRST, "25.10.2026 02:59", "")] == [
        True,
        True,
        False,
        False,
    ]
