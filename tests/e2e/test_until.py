"""`run --until`: ends early, says what is known, and leaves nothing else out."""

import pytest

from campaigns.journal.journal import read_journal
from campaigns.shots.shot_sets import ShotSet

SHOTS, TO_IDENTIFY = 59, 48
REACHABLE = "σ=0.09"


def shots_by_set(folder):
    with read_journal(folder / "campaign.db") as journal:
        purposes = [shot.intent.purpose for shot in journal.shots(1)]
    return {purpose: purposes.count(purpose.value) for purpose in ShotSet}


def test_a_run_ends_early_and_what_it_took_is_enough_to_identify(pkmcal, planned):
    ended = pkmcal("run", planned, "--until", REACHABLE, "--yes", "--json")
    assert ended.code == 0, ended.err
    goal, known = ended.document["goal"], ended.document["knowledge"]
    keys = {"series", "shots", "goal", "knowledge", "skipped", "settling", "next", "before_next"}
    assert set(ended.document) == keys
    assert set(goal) == {"std_mm", "met", "reached_mm", "left_out"}
    assert (goal["std_mm"], goal["met"]) == (0.09, True)
    assert goal["reached_mm"] == known["length_std_mm"] <= 0.09
    assert goal["left_out"] == SHOTS - ended.document["shots"] > 4
    assert known["shots"] == TO_IDENTIFY - goal["left_out"]
    taken = shots_by_set(planned)
    assert (taken[ShotSet.VALIDATION], taken[ShotSet.DRIFT]) == (8, 3)
    assert "goal σ=0.09 met by" in ended.err
    found = pkmcal("identify", planned, "--model", "standard", "--json").document
    assert found["verdict"] == "pass"
    lengths = [p["std"] for n, p in found["parameters"].items() if n.endswith("_mm") and p["std"]]
    assert max(lengths) <= 0.09


def test_what_no_run_can_do_is_refused_before_anything_moves(pkmcal, planned):
    for options, words in (
        ("--yes --until σ=0.001", "the whole plan will give 0.0"),
        ("--dry --until σ=0.09 --fix *_mm", "none of them is free"),
        ("--dry --free arm*.azimuth_deg", "move together, whatever is measured"),
        ("--yes --skip 99", "--skip 99: plan.csv has no such shot"),
    ):
        ended = pkmcal("run", planned, *options.split())
        assert (ended.code, ended.out) == (2, "")
        assert words in ended.error_line
    assert not (planned / "campaign.db").exists()


def test_dry_says_what_the_plan_would_give(pkmcal, planned):
    ended = pkmcal("run", planned, "--dry", "--until", REACHABLE)
    assert ended.code == 0
    assert "predicted for the whole plan: weakest arm" in ended.out
    assert "for goal σ=0.09, " in ended.out
    document = pkmcal("run", planned, "--dry", "--until", REACHABLE, "--json").document
    assert document["shots"] == SHOTS
    assert document["knowledge"]["shots"] == TO_IDENTIFY > document["goal"]["shots"]
    assert not (planned / "campaign.db").exists()


@pytest.mark.parametrize(("goal", "estimator"), [("σ=0.05", "points"), ("σ=0.1", "distances")])
def test_run_foresees_for_a_goal_what_the_plan_was_made_for(pkmcal, planned, goal, estimator):
    words = ("--until", goal, "--estimator", estimator, "--json")
    made = pkmcal("plan", planned, *words, "--candidates", "300").document
    dry = pkmcal("run", planned, "--dry", *words)
    assert dry.code == 0, dry.err
    assert dry.document["goal"]["shots"] == made["shots"]
    foreseen_mm = dry.document["knowledge"]["length_std_mm"]
    assert 0.9 * made["worst"]["length_mm"] < foreseen_mm < 1.1 * made["worst"]["length_mm"]
