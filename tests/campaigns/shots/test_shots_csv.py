"""shots.csv: measured shots in and out, and every way in which other software may write them."""

import math
from dataclasses import replace
from functools import partial

import pytest
from family_cases import VECTORS
from hypothesis import given
from hypothesis import strategies as st
from refusals import refusal, refusal_if_any

from campaigns.errors import OutputExists, ShotsInvalid
from campaigns.kinematics.catalog import PAR4
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots_csv import (
    ShotRow,
    parse_shots,
    read_shots,
    shots_text,
    time_order,
    write_shots,
)

HEADER = "pair,q0_deg,q1_deg,q2_deg,q3_deg,x_mm,y_mm,z_mm\n"
SHOTS = HEADER + (
    "0,1,2,3,4,2000.5,10,-300\n0,5,6,7,8,2100,20,-310\n1,9,8,7,6,2200,30,-320\n1,5,4,3,2,2300,40,-330\n"
)
FULL_HEADER = HEADER.strip() + ",set,theta_deg,sxx,sxy,sxz,syy,syz,szz,temperature_degC,time\n"
FULL = FULL_HEADER + (
    "0,1,2,3,4,2000,10,-300,validation,12.5,4e-4,1e-5,0,3e-4,0,2e-4,21.5,2026-05-04T10:00:00Z\n"
    "0,5,6,7,8,2100,20,-310,validation,,,,,,,,,\n"
)


def read(text):
    return parse_shots(text, "shots.csv", PAR4)


def text_of(shots):
    return shots_text(shots, PAR4)


complaint = partial(refusal, ShotsInvalid, read, begins="shots.csv:")


def test_reference_file_is_read_as_its_digits_say():
    shots = read_shots(VECTORS / "table1-exact.csv", PAR4)
    assert [shot.pair for shot in shots] == [pair for pair in range(60) for _ in range(2)]
    assert {shot.purpose for shot in shots} == {ShotSet.IDENTIFICATION}
    first = shots[0]
    assert first.joints[0] == math.radians(85.868164557)
    assert first.point_in_tracker_mm == (2352.471584, 438.343111, 427.748157)


@pytest.mark.parametrize(
    "text",
    [
        SHOTS.replace(",", ";").replace(".", ","),
        "sep=\t\n" + SHOTS.replace(",", "\t"),
        SHOTS.replace("q0_deg,q1_deg,q2_deg,q3_deg", "J1,J2,J3,J4").upper(),
        SHOTS.replace("\n0,", "\n0.0,").replace("\n1,", "\n1.0,"),
        HEADER + SHOTS,
        "\n".join(f"{n - 1 if n else ''},{line}" for n, line in enumerate(SHOTS.splitlines())),
    ],
)
def test_shots_that_other_programs_wrote_are_the_same_shots(text):
    assert read(text) == read(SHOTS)


def test_optional_columns_are_read_where_they_are_filled():
    first, second = read(FULL)
    assert first.purpose is second.purpose is ShotSet.VALIDATION
    assert first.turn == (math.radians(12.5),)
    assert first.covariance_mm2 == ((4e-4, 1e-5, 0.0), (1e-5, 3e-4, 0.0), (0.0, 0.0, 2e-4))
    assert (first.temperature_degC, first.time) == (21.5, "2026-05-04T10:00:00Z")
    assert (second.turn, second.covariance_mm2) == ((), None)
    assert (second.temperature_degC, second.time) == (None, None)


def test_columns_may_stand_in_any_order_and_some_be_left_out():
    turned = "\n".join(",".join(reversed(line.split(","))) for line in FULL.splitlines())
    assert read(turned) == read(FULL)
    text = HEADER.strip() + ",set\n,1,2,3,4,2000,10,-300,drift\n"
    assert read(text)[0].purpose is ShotSet.DRIFT
    assert read(text)[0].pair is None
    text = HEADER.strip() + ",set\n0,1,2,3,4,2000,10,-300,\n0,1,2,3,4,2000,10,-300,\n"
    assert read(text)[0].purpose is ShotSet.IDENTIFICATION


@pytest.mark.parametrize(
    ("text", "old", "new", "line", "words"),
    [
        (SHOTS, "x_mm,", "", 1, "column x_mm is missing"),
        (SHOTS, "2000.5", "none", 2, "x_mm is 'none', must be a number"),
        (SHOTS, "\n0,5", "\n,5", 3, "pair is empty"),
        (SHOTS, ",9,8,7,6,", ",9,8,7,900,", 4, "q3_deg is '900', must be a number within ±360"),
        (FULL, "4e-4,", ",", 2, "covariance without sxx"),
        (FULL, "4e-4", "0", 2, "not positive definite"),
        (FULL, "validation,12", "identification,12", 3, "half identification, half validation"),
        (FULL, "21.5", "warm", 2, "temperature_degC is 'warm', must be a number"),
    ],
)
def test_broken_row_is_answered_with_its_line(text, old, new, line, words):
    assert old in text
    said = complaint(text.replace(old, new, 1))
    assert said.startswith(f"shots.csv:{line}: ")
    assert len(said) < 250
    assert words in said


def test_export_does_not_overwrite(tmp_path):
    path = tmp_path / "shots.csv"
    write_shots(path, read(SHOTS), PAR4)
    with pytest.raises(OutputExists):
        write_shots(path, read(FULL), PAR4)
    assert read_shots(path, PAR4) == read(SHOTS)


def test_exported_columns_hold_something_in_one_line():
    first, second = read(FULL)
    text = text_of([replace(first, time="10:00\r\n1 May"), second])
    assert len(text.splitlines()) == 3
    assert read(text)[0].time == "10:00 1 May"
    assert text_of(read(SHOTS)).splitlines()[0] == HEADER.strip() + ",set"
    assert text_of(read(FULL)).splitlines()[0] == FULL_HEADER.strip()


@given(st.text())
def test_any_text_is_read_or_refused_with_shots_invalid(text):
    for whole in (text, HEADER + text):
        assert "\n" not in refusal_if_any(ShotsInvalid, read, whole)


angles_rad = st.floats(min_value=-6.28, max_value=6.28)
lengths_mm = st.floats(min_value=-1e6, max_value=1e6)
variances = st.floats(min_value=1e-12, max_value=1e3)
small = st.floats(min_value=-0.4, max_value=0.4)
times = st.text().map(lambda text: " ".join(text.split())).filter(bool)


covariances = st.tuples(variances, variances, variances, small).map(
    lambda drawn: (
        (drawn[0], drawn[3] * math.sqrt(drawn[0] * drawn[1]), 0.0),
        (drawn[3] * math.sqrt(drawn[0] * drawn[1]), drawn[1], 0.0),
        (0.0, 0.0, drawn[2]),
    )
)


def rows(pair, purpose):
    return st.builds(
        ShotRow,
        pair=st.just(pair),
        purpose=st.just(purpose),
        joints=st.tuples(angles_rad, angles_rad, angles_rad, angles_rad),
        point_in_tracker_mm=st.tuples(lengths_mm, lengths_mm, lengths_mm),
        turn=st.just(()) | st.tuples(angles_rad),
        covariance_mm2=st.none() | covariances,
        temperature_degC=st.none() | st.floats(min_value=-40.0, max_value=60.0),
        time=st.none() | times,
    )


pairs = st.sampled_from([ShotSet.IDENTIFICATION, ShotSet.VALIDATION]).flatmap(
    lambda purpose: st.tuples(rows(4, purpose), rows(4, purpose), rows(None, ShotSet.DRIFT))
)


@pytest.mark.slow
@given(pairs)
def test_any_shots_are_the_same_shots_after_writing_and_reading(shots):
    text = text_of(shots)
    again = read(text)
    assert text_of(again) == text
    for shot, back in zip(shots, again, strict=True):
        assert back.joints == pytest.approx(shot.joints, rel=0.0, abs=2e-14)
        assert back.turn == pytest.approx(shot.turn, rel=0.0, abs=2e-14)
        assert back.point_in_tracker_mm == shot.point_in_tracker_mm
        assert (back.pair, back.purpose) == (shot.pair, shot.purpose)
        assert back.covariance_mm2 == shot.covariance_mm2
        assert (back.temperature_degC, back.time) == (shot.temperature_degC, shot.time)


@pytest.mark.parametrize(
    ("times", "read_as"),
    [
        (("25.10.2026 02:59", "25.10.2026 02:01"), "2026-10-25T02:59:00"),
        (("10/25/2026 2:59:00 AM", "10/25/2026 2:01:00 AM"), "2026-10-25T02:59:00"),
        (("0,25", "7,5"), "0.25"),
        (("2026-10-25T02:59:00.000Z", "2026-10-25T03:01:00Z"), "2026-10-25T02:59:00.000Z"),
        (("before noon", "later"), "before noon"),
    ],
)
def test_times_are_read_as_other_software_writes_them(times, read_as):
    rows = "".join(f"0;1,5;2;3;4;{2000 + n},5;10;-300;{time}\n" for n, time in enumerate(times))
    shots = read(f"pair;q0_deg;q1_deg;q2_deg;q3_deg;x_mm;y_mm;z_mm;time\n{rows}")
    assert shots[0].time == read_as
    order, _ = time_order([shot.time for shot in shots])
    # the clock of summer time was set back between the rows
    assert order is None if read_as == "before noon" else list(order) == [0, 1]
