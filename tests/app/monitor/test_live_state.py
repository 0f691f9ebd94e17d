"""What the live page is told, from the journal alone."""

from datetime import datetime, timedelta
from pathlib import Path

import pytest
from paper_campaign import CENTRE, MECHANISM, new_campaign

from app.monitor import live_state as live_state_module
from app.monitor.live_state import View, Watched, live_state
from campaigns.evaluation.time_series import time_series
from campaigns.files.lock import Holder
from campaigns.journal import records
from campaigns.journal.journal import read_journal
from campaigns.planning.plan_file import write_plan
from campaigns.shots.shots import shots_of_journal
from drivers.values import Pose

SOMEBODY = Holder(1, "cell-pc", "2026-03-02T08:00:00+00:00")
VIEW = View.from_tracker((2000.0, 0.0, -500.0), (0.0, 0.0, -500.0))


@pytest.fixture
def told(tmp_path):
    """A run of ten shots, and what the page would be told of it."""
    paper = new_campaign(tmp_path / "c")
    plan = paper.plan(3, 1)
    write_plan(paper.campaign.plan_path, plan, MECHANISM)

    def state(shots=6, more=(), held_by=SOMEBODY, **how):
        series = paper.measure("run", plan[:shots], **{"finished": False, "stopped": False} | how)
        with paper.journal() as journal:
            for record in more:
                journal.append(record, series=series)
            entries, every = journal.records(), journal.series()
        now = datetime.fromisoformat(entries[-1].at_utc)
        watched = Watched(series=every[-1], plan=plan, held_by=held_by)
        watched.take_up(entries[:9])
        watched.take_up(entries[9:])
        return live_state(watched, VIEW, MECHANISM, "cell 7", now)

    return state


def intent(shot: int) -> records.Intent:
    return records.Intent(shot, 1, "identification", Pose(*CENTRE), (0.0,) * 4, "joints", 3)


def test_shots_done_and_left_and_the_end_by_the_clock(told):
    state = told(more=(intent(6),))
    assert (state["done"], state["total"]) == (6, 10)
    assert (state["colour"], state["state"]) == ("green", "measuring")
    places = [shot["state"] for shot in state["map"]]
    assert places == ["done"] * 6 + ["now"] + ["left"] * 3
    low, high = (datetime.fromisoformat(each) for each in state["end_utc"])
    now = datetime.fromisoformat(state["now_utc"])
    assert timedelta() < low - now <= high - now < timedelta(seconds=60)


@pytest.mark.parametrize(
    ("more", "held_by", "how", "colour", "state"),
    [
        ((), None, {}, "red", "ended without a word"),
        ((), None, {"stopped": True}, "green", "stopped"),
        ((), None, {"stopped": True, "finished": True}, "green", "finished"),
        ((), SOMEBODY, {"finished": True}, "green", "finished"),
        ((records.Event("beam broken", "lost"),), SOMEBODY, {}, "red", "the beam is broken"),
        (
            (records.Event("beam broken", "lost"), records.Event("resumed", "seen")),
            SOMEBODY,
            {},
            "green",
            "measuring",
        ),
    ],
)
def test_the_last_word_of_the_journal_gives_the_colour(told, more, held_by, how, colour, state):
    found = told(more=more, held_by=held_by, **how)
    assert (found["colour"], found["state"]) == (colour, state)


def test_a_lost_beam_and_a_skipped_shot_are_on_the_map(told):
    skipped = records.Event("shot skipped", "shot 8 cannot be measured", (8, 7))
    state = told(more=(intent(6), records.Event("beam broken", "lost"), skipped))
    assert state["lost"] == [VIEW.place(Pose(*CENTRE))]
    assert [s["shot"] for s in state["map"] if s["state"] == "skipped"] == [7, 8]
    assert state["total"] == 8
    assert [event["text"] for event in state["events"]] == [skipped.text, "lost"]


def test_of_a_long_plan_no_more_is_told_than_fits_on_a_screen(told, monkeypatch):
    skipped = records.Event("shot skipped", "shot 8 cannot be measured", (8,))
    lost = [records.Event("beam broken", f"lost {number}") for number in range(9)]
    whole = told(more=(intent(6), skipped, *lost))
    for name in ("MOST_PLACES", "MOST_LOST", "MOST_POINTS"):
        monkeypatch.setattr(live_state_module, name, 2)
    few = told(more=(intent(6), skipped, *lost))
    for state in (whole, few):
        assert (state["done"], state["total"], len(state["events"])) == (6, 9, 8)
        marked = [(s["shot"], s["state"]) for s in state["map"] if s["state"] in {"now", "skipped"}]
        assert marked == [(6, "now"), (8, "skipped")]
    assert [len(state["map"]) for state in (whole, few)] == [10, 3]
    assert [len(state["lost"]) for state in (whole, few)] == [9, 2]


def test_drift_is_that_of_all_shots_of_the_series(told, tmp_path):
    state = told(shots=10)
    with read_journal(tmp_path / "c" / "campaign.db") as journal:
        (series,) = journal.series()
    every = time_series("", shots_of_journal(series.shots, MECHANISM))
    assert [at_s for at_s, _ in state["drift"]] == pytest.approx(every.drift_s, abs=1e-3)
    assert [mm for _, mm in state["drift"]] == pytest.approx(every.drift_mm, abs=1e-5)
    assert len(state["drift"]) > 1


def test_the_map_is_as_the_tracker_sees_it():
    right, up = VIEW.place(Pose(0.0, 100.0, -400.0, 0.0))
    assert (right, up) == pytest.approx((0.1, 0.1))


def test_nothing_measured_is_a_state_too():
    state = live_state(Watched(phase="planned"), VIEW, MECHANISM, "c", datetime.now().astimezone())
    assert (state["colour"], state["done"], state["total"]) == ("grey", 0, None)


def test_the_page_is_in_the_package():
    folder = Path(__file__).parents[3] / "app" / "monitor"
    assert (folder / "live.html").is_file()
