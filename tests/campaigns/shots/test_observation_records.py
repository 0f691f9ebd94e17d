"""Observations in the journal: a record a file, of each name the latest, old journals without."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from campaigns.campaign import now_utc
from campaigns.errors import FindingUnreadable, ObservationsInvalid
from campaigns.journal.journal import open_journal, read_journal
from campaigns.journal.records import Finding, adapter_of
from campaigns.shots.import_export import ImportedFile
from campaigns.shots.observation_records import (
    NO_OBSERVATIONS,
    PlannedRow,
    RecordedFile,
    append_measured,
    append_observations,
    recorded_observations,
    refuse_copied_observations,
)
from campaigns.shots.observations_csv import ObservationRow
from campaigns.shots.shot_sets import ShotSet

DATA = Path(__file__).parents[2] / "data"
HEIGHT = ObservationRow("height", "bed", ((0.1, 0.2, 0.3),), (0.5,), 0.01, line=2, file="h.csv")
WIDTH = ObservationRow(
    "distance",
    "part",
    ((0.1, 0.2, 0.3), (0.2, 0.2, 0.3)),
    (60.0,),
    0.05,
    purpose=ShotSet.VALIDATION,
    pair="1",
    time="2026-11-21T09:00:00Z",
    session=2,
    line=4,
    file="w.csv",
)


def opened(path):
    return open_journal(path, now_utc=now_utc, waits_for_disk=False)


def test_of_each_file_name_the_latest_counts(tmp_path):
    with opened(tmp_path / "campaign.db") as journal:
        append_observations(journal, [HEIGHT], ImportedFile("h.csv", "1"))
        append_observations(journal, [WIDTH], ImportedFile("w.csv", "2"))
        append_observations(journal, [HEIGHT, HEIGHT], ImportedFile("h.csv", "3"))
    with read_journal(tmp_path / "campaign.db") as journal:
        observations = recorded_observations(journal)
    assert [(file.name, file.sha256) for file in observations.files] == [
        ("w.csv", "2"),
        ("h.csv", "3"),
    ]
    assert observations.rows == (WIDTH, HEIGHT, HEIGHT)
    assert (observations.latest, observations.record) == ("h.csv", 3)


@pytest.mark.parametrize(
    ("changed", "is_named"),
    [
        ({"std_mm": 0.002}, True),
        ({"std_mm": 0.002, "std_source": "Acme 9, typed by A. Bee"}, True),
        ({"std_mm": 0.002, "time": None}, True),
        ({"std_mm": 0.05}, False),
        ({"std_mm": 0.002, "time": "2026-11-22T09:00:00Z"}, False),
        ({"std_mm": 0.002, "values": (60.01,)}, False),
    ],
)
@pytest.mark.parametrize("name", ["w.csv", "again.csv"])
def test_a_smaller_std_of_the_same_measurement_is_named(tmp_path, name, changed, is_named):
    with opened(tmp_path / "campaign.db") as journal:
        append_observations(journal, [WIDTH, HEIGHT], ImportedFile("w.csv", "1"))
        again = [replace(WIDTH, **changed), HEIGHT]
        append_observations(journal, again, ImportedFile(name, "2"))
        restated = recorded_observations(journal).restated
        assert [(each.file, each.earlier, each.count) for each in restated] == (
            [(name, "w.csv", 1)] if is_named else []
        )
        assert all((each.then_mm, each.now_mm) == (0.05, 0.002) for each in restated)
        append_observations(journal, [WIDTH, HEIGHT], ImportedFile(name, "3"))
        assert not recorded_observations(journal).restated, "what was stated first counts"


def test_what_a_run_measured_keeps_the_std_that_it_was_measured_with(tmp_path):
    planned = PlannedRow(replace(HEIGHT, values=(), std_source="default"))
    measured = replace(HEIGHT, std_source="default", time="2026-11-21T09:00:00Z")
    with opened(tmp_path / "campaign.db") as journal:
        append_measured(journal, "observations.csv", planned, measured)
        lowered = replace(measured, std_mm=0.001, std_source="")
        append_observations(journal, [lowered], ImportedFile("observations.csv", "1"))
        (restated,) = recorded_observations(journal).restated
    assert (restated.then_mm, restated.now_mm) == (0.01, 0.001)


def test_rows_of_older_journals_have_no_source(tmp_path):
    body = adapter_of(RecordedFile).dump_python(RecordedFile("h.csv", "1", (HEIGHT,)), mode="json")
    assert body["rows"][0].pop("std_source", "") is None
    with opened(tmp_path / "campaign.db") as journal:
        journal.append(Finding("observations", body))
        (row,) = recorded_observations(journal).rows
    assert row == HEIGHT
    assert row.std_source_in_words == "not recorded by the software of that time"


@pytest.mark.parametrize("name", ["journal-v1.db", "journal-v2.db"])
def test_an_old_journal_holds_none(tmp_path, name):
    path = tmp_path / "campaign.db"
    shutil.copy(DATA / name, path)
    with read_journal(path) as journal:
        assert recorded_observations(journal) == NO_OBSERVATIONS


def test_a_record_of_another_form_is_named(tmp_path):
    with opened(tmp_path / "campaign.db") as journal:
        journal.append(Finding("observations", {"name": "h.csv", "rows": []}))
        with pytest.raises(FindingUnreadable, match="observations, sha256"):
            recorded_observations(journal)


def test_a_copy_counts_once():
    file = RecordedFile("h.csv", "1", (HEIGHT,))
    with pytest.raises(ObservationsInvalid, match=r"7: is a copy of h\.csv:2") as error:
        refuse_copied_observations([replace(HEIGHT, line=7)], [file], "again.csv")
    assert "time" in error.value.remedy
    with pytest.raises(ObservationsInvalid, match="3: is a copy of line 2"):
        refuse_copied_observations([HEIGHT, replace(HEIGHT, line=3)], (), "h.csv")


@pytest.mark.parametrize(
    "other",
    [
        replace(HEIGHT, object="plate"),
        replace(HEIGHT, values=(0.5000001,)),
        replace(HEIGHT, joints=((0.1, 0.2, 0.31),)),
        replace(HEIGHT, time="2026-11-21T09:00:00Z"),
    ],
)
def test_what_differs_is_no_copy(other):
    refuse_copied_observations([HEIGHT, replace(other, line=3)], (), "h.csv")
