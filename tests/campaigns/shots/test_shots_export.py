"""A journal's shots as a file for other software: whole pairs, the same shots when read again."""

from dataclasses import replace

from campaigns.journal.journal import open_journal
from campaigns.journal.records import Intent, Outcome, SeriesStarted
from campaigns.journal.views import AcceptedShot, Series
from campaigns.kinematics.catalog import PAR4
from campaigns.robots.robot import find_robot
from campaigns.shots.import_export import ImportedSeries, append_import, exported_shots
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import read_note
from campaigns.shots.shots_csv import ShotRow
from drivers.values import Pose, Weather

MEASURED = "2026-05-04T10:00:00.000Z"
AIR = Weather(21.5, 1013.25, 50.0)
COVARIANCE = ((4e-4, 1e-5, 0.0), (1e-5, 3e-4, 0.0), (0.0, 0.0, 2e-4))


def series(stage="run"):
    started = SeriesStarted(stage, "", {}, "1", "", None, None, None)
    return Series(1, MEASURED, started, finished=False)


def shot(number, pair, purpose="identification", **changes):
    intent = Intent(number, 1, purpose, Pose(1.0, 2.0, -3.0, 0.25), (0.1,) * 4, "joints", pair)
    joints, point_mm = (0.1, 0.2, 0.3, 0.4), (2000.0 + number, 10.0, -300.0)
    outcome = Outcome(number, 1, joints, point_mm, COVARIANCE, AIR, "", "", None)
    return AcceptedShot(intent, replace(outcome, **changes), MEASURED)


def test_time_of_an_import_is_read_from_the_note_of_older_journals():
    assert read_note("imported, measured 2025-01-01") == (None, "2025-01-01")
    assert read_note("00000010 41.5") == (None, None)


def test_row_says_what_the_journal_says():
    (row, _), halves = exported_shots(series(), [shot(0, 7), shot(1, 7)], PAR4)
    assert row == ShotRow(
        pair=7,
        joints=(0.1, 0.2, 0.3, 0.4),
        point_in_tracker_mm=(2000.0, 10.0, -300.0),
        purpose=ShotSet.IDENTIFICATION,
        turn=(0.25,),
        covariance_mm2=COVARIANCE,
        temperature_degC=21.5,
        time=MEASURED,
    )
    assert halves == ()


def test_half_a_pair_is_left_out_and_said():
    shots = [shot(0, 0), shot(1, 0), shot(2, 1), shot(3, None, "drift")]
    rows, halves = exported_shots(series(), shots, PAR4)
    assert [row.point_in_tracker_mm[0] for row in rows] == [2000.0, 2001.0, 2003.0]
    assert halves == (2,)


def test_imported_shots_come_out_as_they_came_in(tmp_path):
    rows = (
        ShotRow(3, (0.2, 0.3, 0.4, 0.3), (2000.0, 10.0, -300.0), time="2025-01-01"),
        ShotRow(3, (0.3, 0.3, 0.4, 0.3), (2100.0, 10.0, -300.0)),
        ShotRow(
            4, (0.2, 0.3, 0.4, 0.4), (2050.0, 10.0, -300.0), temperature_degC=21.4, time="noon"
        ),
        ShotRow(4, (0.3, 0.2, 0.4, 0.3), (2150.0, 10.0, -300.0), temperature_degC=-3.125),
        ShotRow(5, (0.3, 0.2, 0.4, 0.4), (2150.0, 20.0, -300.0), part_temperature_degC=24.5),
        ShotRow(5, (0.3, 0.2, 0.3, 0.4), (2150.0, 30.0, -300.0), time="noon"),
    )
    robot = find_robot("par4-prototype").robot
    path = tmp_path / "campaign.db"
    with open_journal(path, now_utc=lambda: MEASURED) as journal:
        origin = ImportedSeries(robot.digest(), {})
        number = append_import(journal, rows, robot.kinematics, origin)
        found = journal.latest_series("import")
        exported, _ = exported_shots(found, journal.shots(number), robot.mechanism)
    assert exported == rows
