"""Shots measured with other software, taken into the journal."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fake_cell import NOMINAL, ROBOT
from small_plans import FOUR_PAIRS
from tested_journal import plain_journal

from campaigns.errors import ShotsInvalid
from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.planning.plans import poses_of
from campaigns.shots.import_export import (
    ImportedFile,
    ImportedSeries,
    append_import,
    exported_shots,
    imported_files,
    refuse_copies,
)
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import shots_of_journal
from campaigns.shots.shots_csv import (
    ShotRow,
    parse_shots,
    set_back_before,
    shots_text,
    steady_times_s,
    time_order,
)

SERIES = ImportedSeries(ROBOT.digest(), {})
COVARIANCE_MM2 = ((1e-4, 1e-5, 0.0), (1e-5, 2e-4, 0.0), (0.0, 0.0, 3e-4))


def rows() -> tuple[ShotRow, ...]:
    return tuple(
        ShotRow(shot.pair, shot.joints, (1000.0 + shot.shot, 2.0, 3.0), shot.purpose)
        for shot in FOUR_PAIRS[1:-1]
    )


def imported(folder: Path, shots: tuple[ShotRow, ...]):
    with plain_journal(folder) as journal:
        series = append_import(journal, shots, NOMINAL, SERIES)
        return journal.latest_series("import"), journal.shots(series)


def test_import_is_a_finished_series_with_every_row_in_its_order(tmp_path: Path) -> None:
    series, shots = imported(tmp_path, rows())
    assert series.finished
    assert series.started.robot_file_digest == ROBOT.digest()
    assert [shot.intent.shot for shot in shots] == list(range(8))
    data = shots_of_journal(shots, ROBOT.mechanism)
    assert data.pairs == (0, 0, 1, 1, 2, 2, 3, 3)
    assert data.points_in_tracker_mm[:, 0].tolist() == [1001.0 + row for row in range(8)]
    assert data.joints == pytest.approx(np.array([row.joints for row in rows()]))
    assert np.isnan(data.stated_covariance_mm2).all()
    poses = poses_of(FOUR_PAIRS[1:-1])
    assert data.commanded == pytest.approx(poses, abs=1e-6), "the nominal robot's at its joints"
    assert imported_files(series.started) == ()


def test_only_shots_without_a_covariance_get_the_instruments(tmp_path: Path) -> None:
    told = tuple(
        row if place % 2 else replace(row, covariance_mm2=COVARIANCE_MM2)
        for place, row in enumerate(rows())
    )
    _, shots = imported(tmp_path, told)
    completed = shots_of_journal(shots, ROBOT.mechanism).covariance_mm2(TrackerUncertainty())
    as_stated = [np.array_equal(each, np.array(COVARIANCE_MM2)) for each in completed]
    assert as_stated == [True, False] * 4
    assert np.isfinite(completed).all()


def test_joints_that_the_nominal_robot_cannot_take_are_refused_before_anything_is_written(
    tmp_path: Path,
) -> None:
    wrong = tuple(np.radians([90.0, -90.0, 90.0, -90.0]).tolist())
    shots = (*rows()[:3], replace(rows()[3], joints=wrong), *rows()[4:])
    with plain_journal(tmp_path) as journal:
        with pytest.raises(ShotsInvalid, match="shot 4 of the file: the nominal robot cannot"):
            append_import(journal, shots, NOMINAL, SERIES)
        assert journal.last_number() == 0


def test_of_an_import_that_breaks_off_nothing_is_taken_in(tmp_path: Path) -> None:
    with plain_journal(tmp_path) as journal:
        with pytest.raises(IndexError):
            append_import(journal, rows(), NOMINAL, SERIES, np.array([0, 1, 99]))
        assert journal.last_number() == 0
        again = append_import(journal, rows(), NOMINAL, SERIES)
        assert (again, len(journal.shots(again))) == (1, len(rows()))


def test_shots_are_numbered_as_the_rows_and_written_in_the_order_of_time(tmp_path: Path) -> None:
    times = ["2026-03-02T08:05:00Z", "2026-03-02T09:04:00+01:00", *["2026-03-02T09:00:00Z"] * 6]
    told = [replace(row, time=time) for row, time in zip(rows(), times, strict=True)]
    order, lacking = time_order([row.time or "" for row in told])
    assert order is not None
    assert (order.tolist(), lacking) == ([1, 0, 2, 3, 4, 5, 6, 7], "")
    with plain_journal(tmp_path) as journal:
        series = append_import(journal, told, NOMINAL, SERIES, order)
        data = shots_of_journal(journal.shots(series), ROBOT.mechanism)
    assert data.numbers == tuple(range(8))
    assert data.points_in_tracker_mm[:, 0].tolist() == [1001.0 + row for row in range(8)]
    assert data.order_of_time().tolist() == order.tolist()


def test_shots_of_a_file_without_times_have_none_of_the_journal(tmp_path: Path) -> None:
    """Otherwise slow motions would follow the clock of the import, another one at each import."""
    _, shots = imported(tmp_path, (replace(rows()[0], time="2026-03-02 08:00"), *rows()[1:]))
    data = shots_of_journal(shots, ROBOT.mechanism)
    assert data.measured_utc == ("2026-03-02 08:00", *[""] * 7)
    assert data.elapsed_s() is None
    assert data.order_of_time().tolist() == list(range(8))


@pytest.mark.parametrize(
    ("times", "order", "why"),
    [
        (["12.5", "3", "1e1"], [1, 2, 0], ""),
        (["2026-03-02 08:00", "2026-03-01", "20260301T070000"], [1, 2, 0], ""),
        (["", "", ""], None, "there is no column time"),
        (["1", "", "2"], None, "shot 1 has no time"),
        (["1", "2", "nan"], None, "times are not all"),
        (["2026-03-02T08:00:00Z", "2026-03-02T08:00:00"], None, "with a zone"),
    ],
)
def test_the_order_of_time_is_read_or_it_is_said_why_not(times, order, why) -> None:
    found, lacking = time_order(times)
    assert (found if found is None else found.tolist()) == order
    assert why in lacking


def test_copies_of_pairs_are_found_in_the_file_and_in_the_journal(tmp_path: Path) -> None:
    """Hold-out pairs too; what is visited again and again may be the same to the last digit."""
    once = rows()
    refuse_copies(once, (), "f.csv")
    unseen = [replace(row, purpose=ShotSet.VALIDATION) for row in once[:2]]
    with pytest.raises(ShotsInvalid, match=r"^f\.csv: shot 8 is a copy of shot 0: its joints and"):
        refuse_copies([*once, *unseen], (), "f.csv")
    still = [replace(once[0], pair=None, purpose=ShotSet.DRIFT)] * 2
    refuse_copies([*once, *still], (), "f.csv")
    other = [replace(row, point_in_tracker_mm=(0.0, 0.0, 1.0 + row.joints[0])) for row in once]
    with plain_journal(tmp_path) as journal:
        append_import(journal, once[4:], NOMINAL, SERIES)
        refuse_copies(other, journal.series(), "f.csv")
        with pytest.raises(ShotsInvalid, match=r"shot 4 is a copy of shot 0 of series 1 "):
            refuse_copies(once, journal.series(), "f.csv")


def test_names_and_digests_of_the_files_are_kept_with_the_series(tmp_path: Path) -> None:
    points, joints = tmp_path / "points.txt", tmp_path / "joints.csv"
    points.write_bytes(b"abc")
    joints.write_bytes(b"")
    files = tuple(ImportedFile.of(path) for path in (points, joints))
    abc = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad"
    assert files[0] == ImportedFile("points.txt", abc)
    with plain_journal(tmp_path) as journal:
        append_import(
            journal, rows(), NOMINAL, ImportedSeries(ROBOT.digest(), {"name": "test"}, files)
        )
        started = journal.series("import")[0].started
    assert imported_files(started) == files
    assert started.configuration["name"] == "test"


def test_known_lengths_need_no_joints_and_come_back_out(tmp_path: Path) -> None:
    lengths = tuple(
        ShotRow(9, (), (1000.0 * end, 2.0, 3.0), ShotSet.KNOWN_LENGTH) for end in (1, 2)
    )
    text = shots_text((*rows(), *lengths), ROBOT.mechanism)
    assert parse_shots(text, "shots.csv", ROBOT.mechanism)[-2:] == lengths
    series, shots = imported(tmp_path, (*rows(), *lengths))
    data = shots_of_journal(shots, ROBOT.mechanism)
    assert np.isnan(data.joints[-2:]).all()
    assert np.isfinite(data.joints[:-2]).all()
    pairs = data.whole_pairs(ShotSet.KNOWN_LENGTH).rows
    assert data.measured_distances_mm(pairs) == pytest.approx([1000.0])
    assert exported_shots(series, shots, ROBOT.mechanism)[0][-2:] == lengths
    assert not series.of_known_lengths


def test_sides_of_the_joints_are_read_kept_and_come_back_out(tmp_path: Path) -> None:
    sides = ((1, -1, 0, 1), (-1, -1, 1, 1))
    told = [replace(row, approach=sides[n % 2]) for n, row in enumerate(rows())]
    text = shots_text(told, ROBOT.mechanism)
    assert "q0_approach,q1_approach,q2_approach,q3_approach" in text
    assert [row.approach for row in parse_shots(text, "x", ROBOT.mechanism)] == [*sides] * 4
    as_elsewhere = text
    for joint in range(4):
        as_elsewhere = as_elsewhere.replace(f"q{joint}_approach", f"side{joint}")
    assert parse_shots(as_elsewhere, "x", ROBOT.mechanism)[0].approach == sides[0]
    series, shots = imported(tmp_path, tuple(told))
    data = shots_of_journal(shots, ROBOT.mechanism)
    assert data.approach.tolist() == [list(row.approach) for row in told]
    again, _ = exported_shots(series, shots, ROBOT.mechanism)
    assert [row.approach for row in again] == [row.approach for row in told]
    with pytest.raises(ShotsInvalid, match="q0_approach is '2'"):
        parse_shots(text.replace(",1,-1,0,1", ",2,-1,0,1"), "x", ROBOT.mechanism)


NIGHT = ("2026-10-25T02:40:00", "2026-10-25T02:59:20", "2026-10-25T02:15:00", "2026-10-25T02:34:00")


@pytest.mark.parametrize(
    ("times", "row"),
    [
        (NIGHT, 2),
        (("2026-11-01T01:58:00", "2026-11-01T01:59:00", "2026-11-01T01:00:00"), 2),
        (("2026-04-05T02:30:00", "2026-04-05T01:45:00", "2026-04-05T03:00:00"), 1),
    ],
)
def test_times_of_a_clock_that_was_set_back_by_an_hour_keep_the_order_of_rows(times, row):
    assert set_back_before(times) == row
    order, _ = time_order(times)
    assert order.tolist() == [*range(len(times))]
    seconds, _ = steady_times_s(times)
    assert (np.diff(seconds) > 0.0).all()


@pytest.mark.parametrize(
    "times",
    [
        [f"{time}+02:00" for time in NIGHT],
        NIGHT[::-1],
        (NIGHT[2], *NIGHT[:2]),
        ("2026-10-25T02:40:00", "2026-10-25T02:30:00"),
        ("2026-10-25T12:40:00", "2026-10-25T02:30:00"),
        ("5000", "2000", "2500"),
        ("", *NIGHT[1:]),
    ],
)
def test_other_times_are_those_of_no_clock_that_was_set_back(times):
    assert set_back_before(times) is None
