"""`run --until`: ends early, says what is known, and leaves nothing else out."""

import pytest

from campaigns.journal.journal import read_journal
from campaigns.planning import optimal_plan
from campaigns.shots.shot_sets import ShotSet

GOAL_MM = 0.07
SHOTS, TO_IDENTIFY = 47, 36


@pytest.fixture
def longer_plan(pkmcal, planned):
    """A campaign with shots enough to meet the goal before the last of them."""
    settings = planned / "campaign.yaml"
    text = settings.read_text()
    assert "validation_pairs: 3" in text
    settings.write_text(text.replace("validation_pairs: 3", "validation_pairs: 4"))
    ended = pkmcal("plan", planned, "--shots", TO_IDENTIFY)
    assert ended.code == 0, ended.err
    return planned


def shots_by_set(folder):
    with read_journal(folder / "campaign.db") as journal:
        purposes = [shot.intent.purpose for shot in journal.shots(1)]
    return {purpose: purposes.count(purpose.value) for purpose in ShotSet}


def test_a_run_ends_early_and_what_it_took_is_enough_to_identify(pkmcal, longer_plan):
    ended = pkmcal("run", longer_plan, "--until", GOAL_MM, "--yes", "--json")
    assert ended.code == 0, ended.err
    goal, known = ended.document["goal"], ended.document["knowledge"]
    assert {"schema", "skipped", "settling", "next"} <= set(ended.document)
    assert set(goal) == {"std_mm", "met", "reached_mm", "left_out"}
    assert (goal["std_mm"], goal["met"]) == (GOAL_MM, True)
    assert goal["reached_mm"] == known["position_std_mm"] <= GOAL_MM
    assert goal["left_out"] == SHOTS - ended.document["shots"] > 4
    assert known["shots"] == TO_IDENTIFY - goal["left_out"]
    taken = shots_by_set(longer_plan)
    assert (taken[ShotSet.VALIDATION], taken[ShotSet.DRIFT]) == (8, 3)
    assert f"goal {GOAL_MM} mm met by" in ended.err
    found = pkmcal("identify", longer_plan, "--json").document
    assert found["verdict"] == "pass"
    assert found["position_std_mm"]["mean"] <= 1.01 * GOAL_MM


def test_what_no_run_can_do_is_refused_before_anything_moves(pkmcal, planned):
    for options, words in (
        ("--yes --until 0.0001", "the whole plan will give 0.0"),
        ("--yes --until much", "must be above 0 and at most 10 mm"),
        ("--yes --skip 99", "--skip 99: plan.csv has no such shot"),
    ):
        ended = pkmcal("run", planned, *options.split())
        assert (ended.code, ended.out) == (2, "")
        assert words in ended.error_line
    assert not (planned / "campaign.db").exists()


def test_run_foresees_for_a_goal_what_the_plan_was_made_for(pkmcal, planned, monkeypatch):
    monkeypatch.setattr(optimal_plan, "CANDIDATES", 400)  # choosing among all takes seconds
    words = ("--until", "0.06", "--json")
    made = pkmcal("plan", planned, *words, "--shots", 80).document
    dry = pkmcal("run", planned, "--dry", *words)
    assert dry.code == 0, dry.err
    assert made["shots"] - 4 <= dry.document["goal"]["shots"] <= made["shots"]
    assert not (planned / "campaign.db").exists()
    foreseen_mm = dry.document["knowledge"]["position_std_mm"]
    assert foreseen_mm == pytest.approx(made["position_std_mm"]["mean"], rel=0.01)
