"""`run --until`: ends early, says what is known, and leaves nothing else out."""

import pytest

from campaigns.journal.journal import read_journal
from campaigns.shots.shot_sets import ShotSet

SHOTS, TO_IDENTIFY = 59, 48
REACHABLE = "σ=0.09"


def until(pkmcal, folder, goal, *options):
    return pkmcal("run", folder, "--until", goal, "--yes", "--json", *options)


def shots_by_set(folder):
    with read_journal(folder / "campaign.db") as journal:
        purposes = [shot.intent.purpose for shot in journal.shots(1)]
    return {purpose: purposes.count(purpose.value) for purpose in ShotSet}


def test_a_run_ends_early_and_what_it_took_is_enough_to_identify(pkmcal, planned):
    ended = until(pkmcal, planned, REACHABLE)
    assert ended.code == 0, ended.err
    goal, known = ended.document["goal"], ended.document["knowledge"]
    assert set(ended.document) == {"series", "shots", "goal", "knowledge", "skipped"}
    assert set(goal) == {"std_mm", "met", "reached_mm", "left_out"}
    assert (goal["std_mm"], goal["met"]) == (0.09, True)
    assert goal["reached_mm"] == known["length_std_mm"] <= 0.09
    assert goal["left_out"] == SHOTS - ended.document["shots"] > 4
    assert known["shots"] == TO_IDENTIFY - goal["left_out"]
    taken = shots_by_set(planned)
    assert (taken[ShotSet.VALIDATION], taken[ShotSet.DRIFT]) == (8, 3)
    assert "goal σ=0.09 met by" in ended.err
    found = pkmcal("identify", planned, "--json").document
    assert found["verdict"] == "pass"
    lengths = [p["std"] for n, p in found["parameters"].items() if n.endswith("_mm") and p["std"]]
    assert max(lengths) <= 0.09


def test_a_goal_out_of_the_plans_reach_is_refused_before_anything_moves(pkmcal, planned):
    for options in ((), ("--dry",)):
        ended = until(pkmcal, planned, "σ=0.001", *options)
        assert ended.code == 2
        assert "goal σ=0.001: the whole plan will give 0.0" in ended.error_line
        assert "pkmcal plan --until σ=0.001" in ended.error_line
        assert ended.out == ""
    assert not (planned / "campaign.db").exists()


def test_dry_says_what_the_plan_would_give(pkmcal, planned):
    ended = pkmcal("run", planned, "--dry", "--until", REACHABLE)
    assert ended.code == 0
    assert "the whole of it will tell: weakest arm" in ended.out
    assert "for goal σ=0.09, " in ended.out
    document = pkmcal("run", planned, "--dry", "--until", REACHABLE, "--json").document
    assert document["shots"] == SHOTS
    assert document["knowledge"]["shots"] == TO_IDENTIFY > document["goal"]["shots"]
    assert not (planned / "campaign.db").exists()


@pytest.mark.long
def test_more_parameters_to_find_take_more_shots_for_the_same_goal(pkmcal, planned):
    words = ("--dry", "--json", "--until", REACHABLE)
    usual = pkmcal("run", planned, *words).document
    more = pkmcal("run", planned, *words, "--free", "arm[123].azimuth_deg").document
    assert more["goal"]["shots"] > usual["goal"]["shots"]
    assert more["knowledge"]["length_std_mm"] > usual["knowledge"]["length_std_mm"]
    ended = pkmcal("run", planned, "--dry", "--free", "arm*.azimuth_deg")
    assert ended.code == 2
    assert "move together, whatever is measured" in ended.error_line
    ended = pkmcal("run", planned, "--dry", "--free", "arm9.*")
    assert ended.code == 2
    assert "arm9.* matches no parameter" in ended.error_line


@pytest.mark.long
def test_a_goal_for_lengths_needs_one_and_a_run_does_not(pkmcal, planned):
    held = ("--fix", "*_mm")
    ended = until(pkmcal, planned, REACHABLE, *held, "--dry")
    assert ended.code == 2
    assert "none of them is free" in ended.error_line
    ended = pkmcal("run", planned, "--yes", *held)
    assert ended.code == 0, ended.err
    assert f"next: pkmcal identify {planned} --fix '*_mm'" in ended.err


@pytest.mark.long
def test_a_plan_for_a_goal_by_distances_is_one_that_a_run_accepts(pkmcal, tmp_path):
    """Also where the tracker is surer along the beam than across it, and with few pairs."""
    folder = tmp_path / "campaign"
    assert pkmcal("new", folder, "--scenario", "realistic").code == 0
    goal = ("--until", "σ=0.1", "--estimator", "distances")
    planned = pkmcal("plan", folder, *goal, "--json", "--candidates", "600")
    assert planned.code == 0, planned.err
    promised = planned.document["worst"]["length_mm"]
    dry = pkmcal("run", folder, "--dry", "--json", *goal)
    assert dry.code == 0, dry.err
    foreseen = dry.document["knowledge"]["length_std_mm"]
    assert 0.9 * promised < foreseen < 1.1 * promised
