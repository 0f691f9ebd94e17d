"""`run` measures what observations.csv plans: in the simulated cell, and by an operator's hand."""

import json
from dataclasses import replace

import numpy as np
import pytest
from command_line import change
from test_by_hand import BY_HAND, Operator

from campaigns.campaign import open_campaign
from campaigns.journal.journal import read_journal
from campaigns.shots.observation_records import append_measured, recorded_observations
from campaigns.shots.observations_csv import ObservationRow, read_observations, write_observations
from campaigns.workflow import observation_run

OBJECTS = [
    {"name": "bed"},
    {"name": "part", "shrinkage_std_percent": 0.3},
    {"name": "probe", "place_mm": [30, 0, -40], "std_mm": 1},
]
STD_MM = 0.01
PLANNED = ("height",) * 8 + ("distance",) * 3 + ("probe",) * 3
OBJECT_OF = {"height": "bed", "distance": "part", "probe": "probe"}


def joints_of(campaign, draw):
    at = [*draw.uniform(-150.0, 150.0, 2), draw.uniform(-640.0, -560.0), 0.0]
    return tuple(campaign.robot.kinematics.inverse([at]).values_or_raise()[0].tolist())


def with_observations(folder, kinds=PLANNED, *, shots=False):
    """Plan observations of these kinds, with the shots that are planned or instead of them."""
    if not shots:
        (folder / "plan.csv").unlink()
    change(folder / "campaign.yaml", {"objects": OBJECTS})
    campaign, draw = open_campaign(folder), np.random.default_rng(7)
    rows = []
    for number, kind in enumerate(kinds):
        poses = 2 if kind == "distance" else 1
        joints = tuple(joints_of(campaign, draw) for _ in range(poses))
        label = str(number) if poses == 2 else ""
        rows.append(ObservationRow(kind, OBJECT_OF[kind], joints, (), STD_MM, pair=label))
    write_observations(folder / "observations.csv", rows, campaign.robot.mechanism, overwrite=True)
    return campaign


def in_file(folder):
    campaign = open_campaign(folder)
    return read_observations(folder / "observations.csv", campaign.robot.mechanism)


def in_journal(folder):
    with read_journal(folder / "campaign.db") as journal:
        return recorded_observations(journal).rows


def records_of(folder):
    with read_journal(folder / "campaign.db") as journal:
        return len(journal.findings("observations"))


def as_measured(rows):
    """Rows to the digits that files keep of angles."""
    rounded = [tuple(round(value, 9) for value in row.values) for row in rows]
    return [(row.kind, row.object, values) for row, values in zip(rows, rounded, strict=True)]


def test_simulated_instruments_fill_the_file_and_keep_the_truth_beside(pkmcal, tiny):
    # where the reflector does not turn with the tool, a probe beside it is off by their distance
    change(tiny / "cell.yaml", {"robot.reflector.offset_mm": [0, 0, 0]})
    with_observations(tiny, shots=True)
    ended = pkmcal("run", tiny, "--yes", "--json")
    assert ended.code == 0, ended.err
    assert ended.document["observations"] == {"measured": 14, "skipped": []}
    assert ended.err.index("has all 10 shots") < ended.err.index("measured: 14 observations")
    assert as_measured(in_file(tiny)) == as_measured(in_journal(tiny))
    assert not any(row.is_planned for row in in_file(tiny))
    kept = json.loads((tiny / "cell-memory.json").read_text())["readings"]
    assert [entry["kind"] for entry in kept] == [*PLANNED]
    for entry, row in zip(kept, in_journal(tiny), strict=True):
        assert row.values == pytest.approx(entry["values"], abs=1e-9)
        away = np.abs(np.subtract(entry["values"], entry["true"]))[:3]
        assert 0.0 < away.max() < 5.0 * STD_MM
    identified = pkmcal("identify", tiny, "--json").document
    (of_flat,) = (row for row in identified["determined"] if row["name"] == "flat")
    assert of_flat["assumed"] < 0.5
    assert "the journal is intact" in pkmcal("check-journal", tiny).out


def test_without_a_plan_observations_are_measured_alone_and_once(pkmcal, tiny):
    with_observations(tiny, ("height",) * 6)
    assert pkmcal("status", tiny, "--json").document["next"].startswith(f"pkmcal run {tiny}")
    assert "6 observations" in pkmcal("run", tiny, "--dry").out
    ended = pkmcal("run", tiny, "--yes", "--json")
    assert ended.document["measured"] == 6
    again = pkmcal("run", tiny, "--yes")
    assert "plan.csv" in again.error_line  # nothing is left, and there are no shots
    assert records_of(tiny) == 6


def test_values_read_in_centimetres_are_doubted(planned):
    campaign = with_observations(planned, ("height",) * 8)
    planned_rows = observation_run.planned_observations(campaign)
    with campaign.journal() as journal:
        for row in planned_rows:
            pose = campaign.robot.kinematics.forward(row.row.joints).values[0]
            height_cm = 0.1 * (pose[2] + 900.0)
            append_measured(journal, "observations.csv", row, replace(row.row, values=(height_cm,)))
    assert "look like" in observation_run.doubt_of(campaign)
    assert not observation_run.planned_observations(campaign)


class Killed(BaseException):
    """The process is gone."""


def test_killed_between_journal_and_file_it_loses_none_and_asks_for_none_twice(
    pkmcal, planned, monkeypatch
):
    with_observations(planned, ("height",) * 6)
    written = []

    def killed_at_the_third(*arguments, **options):
        written.append(arguments)
        if len(written) == 3:
            raise Killed
        write_observations(*arguments, **options)

    monkeypatch.setattr(observation_run, "write_observations", killed_at_the_third)
    with pytest.raises(Killed):
        pkmcal("run", planned, "--yes")
    monkeypatch.undo()
    before = in_journal(planned)
    assert len(before) == 3
    assert sum(not row.is_planned for row in in_file(planned)) == 2
    assert pkmcal("run", planned, "--yes").code == 0
    assert in_journal(planned)[:3] == before
    assert records_of(planned) == 6
    assert as_measured(in_file(planned)) == as_measured(in_journal(planned))


def test_without_a_terminal_observations_by_hand_wait_for_somebody(pkmcal, tiny):
    with_observations(tiny, ("height",) * 6)
    change(tiny / "campaign.yaml", {"tracker": BY_HAND | {"reflector": "C"}})
    ended = pkmcal("run", tiny, "--yes")
    assert ended.code == 2
    assert "no terminal" in ended.error_line or "wait for somebody" in ended.error_line
    assert not (tiny / "campaign.db").exists() or not in_journal(tiny)


class Reader(Operator):
    """An operator who also reads heights: he mistypes one, skips one, and is killed in between."""

    def __init__(self, campaign, answers):
        super().__init__(campaign)
        self.answers, self.tasks = [*answers], []

    def answer(self, asked):
        if asked.endswith("u: the one before again]"):
            self.tasks.append(asked[asked.rindex("height of") :])
            typed = self.answers.pop(0)
            if isinstance(typed, type):
                raise typed
            return typed
        return super().answer(asked)


@pytest.fixture
def heights_by_hand(tiny):
    change(tiny / "campaign.yaml", {"controller": BY_HAND, "tracker": BY_HAND | {"reflector": "C"}})
    with_observations(tiny, ("height",) * 5)
    return tiny


def test_an_operator_types_heights_steps_back_skips_and_is_killed(pkmcal, heights_by_hand):
    campaign = open_campaign(heights_by_hand)
    first = Reader(campaign, ["1.25", "much", "2,50", "u", "2.75", Killed])
    with pytest.raises(Killed):
        first.runs("run", heights_by_hand)
    assert "'much' is no number" in " ".join(first.said.split())
    assert first.tasks[0].startswith("height of bed at x ")
    assert [row.values for row in in_journal(heights_by_hand)] == [(1.25,), (2.75,)]
    again = Reader(campaign, ["3.5", "", "4.5"])
    again.joints_deg = first.joints_deg
    assert again.runs("run", heights_by_hand) == 0, again.said
    assert not again.answers
    assert [row.values for row in in_journal(heights_by_hand)] == [(1.25,), (2.75,), (3.5,), (4.5,)]
    assert sum(row.is_planned for row in in_file(heights_by_hand)) == 1
    assert "height of bed, line 5: skipped by the operator" in " ".join(again.said.split())
    assert "the journal is intact" in pkmcal("check-journal", heights_by_hand).out
