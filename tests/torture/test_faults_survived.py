"""Unattended runs on cells that fail: one command each, all complete, nothing wrong is stored.

What the journal counts is compared with the simulated tracker's own record: the robot's reflector,
and the robot where the encoders were read. With `--times`: ten seeds of the hostile cell, against
the same ones without faults, five scripts at the first shots, and a beam broken for 1 to 600 s
of the cell's time at each of twelve measurements.
"""

import json
from math import degrees

import pytest
from command_line import change

from campaigns.campaign import open_campaign
from campaigns.journal.records import SessionStarted

pytestmark = [pytest.mark.torture, pytest.mark.long]

SCRIPTED = {"plan.shots": 24, "plan.validation_pairs": 2, "plan.drift_shots": 2}
"""A small plan: 30 shots."""
CELL = {"tracker.other_reflector_mm": [900.0, 350.0, -420.0], "speed_up": 10_000}
NEAR_MM, NEAR_UDEG = 1e-6, 1
BREAKS_S = (600.0, 1.0, 3.0, 30.0, 90.0)


def made(pkmcal, folder, scenario, settings, cell):
    assert pkmcal("new", folder, "--scenario", scenario).code == 0
    change(folder / "campaign.yaml", settings)
    change(folder / "cell.yaml", cell)
    assert pkmcal("plan", folder).code == 0
    return folder


def complete_and_true(pkmcal, folder, retry=5):
    """Run it, and see that all is measured and nothing stored wrong; gives its sessions."""
    ran = pkmcal("run", folder, "--yes", "--json", "--retry", retry)
    assert ran.code == 0, ran.err
    campaign = open_campaign(folder)
    with campaign.journal_reader() as journal:
        shots = journal.shots(journal.latest_series("run").number)
        sessions = len(journal.records_of(SessionStarted))
    assert ran.document["shots"] == len(campaign.read_plan()) == len(shots)
    assert wrong_shots(shots, told_in(folder)) == []
    return sessions


def told_in(folder):
    """What the simulated tracker told, as it really was."""
    return json.loads((folder / "cell-memory.json").read_text(encoding="utf-8"))["taken"]


def wrong_shots(shots, truth):
    """Shots that the tracker never told of the robot standing there."""
    return [shot for shot in shots if not any(is_truth(shot.outcome, told) for told in truth)]


def is_truth(outcome, told):
    point, place = told["point_in_tracker_mm"], told["robot_target"]
    stored = [round(degrees(joint) * 1e6) for joint in outcome.joints]
    near = zip(outcome.point_in_tracker_mm, point, strict=True)
    there = zip(stored, place, strict=True)
    return (
        told["on"] == "robot"
        and all(abs(a - b) <= NEAR_MM for a, b in near)
        and all(abs(a - b) <= NEAR_UDEG for a, b in there)
    )


def broken_beam(at, seconds):
    return {"at_measurement": at, "kind": "beam_break", "seconds": seconds}


WRONG = [{"at_measurement": at, "kind": "wrong_target"} for at in (1, 2, 3)]
FIRST_SCRIPTS = [
    [WRONG[0], broken_beam(2, 5.0)],
    [WRONG[0], {"device": "tracker", "at_answer": 45, "kind": "close"}],
    [WRONG[1], WRONG[2]],
    [broken_beam(1, 90.0), broken_beam(2, 5.0), WRONG[2]],
    [WRONG[1], {"at_move": 3, "kind": "drive_fault", "seconds": 500.0}],
]
"""Wrong targets and broken beams at shots 1 to 3, alone and together."""


@pytest.fixture
def survived(pkmcal, tmp_path):
    """Runs a small campaign with these faults, and gives its sessions."""

    def run(name, faults):
        folder = made(pkmcal, tmp_path / name, "realistic", SCRIPTED, CELL | {"faults": faults})
        return complete_and_true(pkmcal, folder)

    return run


def test_wrong_targets_at_the_first_shots_end_in_a_complete_campaign(survived, times):
    for number, script in enumerate(FIRST_SCRIPTS[: 2 * times]):
        survived(f"first-{number}", script)


def test_beam_that_is_broken_for_ten_minutes_only_costs_time(survived, times):
    for seconds in BREAKS_S[:times]:
        for at in range(1, 13) if times > 1 else [3]:
            assert survived(f"break-{seconds:g}-{at}", [broken_beam(at, seconds)]) == 1


def test_unrelated_faults_of_a_hostile_cell_are_survived_by_one_command(pkmcal, tmp_path, times):
    """As many tries in a row as its page promises to be enough."""
    for seed in [17] if times == 1 else range(11, 31):
        folder = made(pkmcal, tmp_path / f"{seed}", "hostile", {}, {"seed": seed})
        complete_and_true(pkmcal, folder, retry=3)


def test_hostile_cell_ends_at_the_parameters_of_one_without_faults(pkmcal, tmp_path, times):
    if times == 1:
        pytest.skip("takes long: only with --times")
    for seed in range(1, min(times, 10) + 1):
        found = []
        for name, cell in (("clean", {"faults": []}), ("hostile", {})):
            folder = tmp_path / f"{name}-{seed}"
            made(pkmcal, folder, "hostile", {}, {"seed": seed, **cell})
            complete_and_true(pkmcal, folder)
            found.append(pkmcal("identify", folder, "--json").document["parameters"])
        clean, faulty = found
        for name, each in clean.items():
            if each["std"]:
                assert abs(faulty[name]["value"] - each["value"]) <= each["std"]


def test_shot_that_the_simulator_has_otherwise_is_found_wrong(survived, tmp_path):
    survived("clean", [])
    truth = told_in(tmp_path / "clean")
    with open_campaign(tmp_path / "clean").journal_reader() as journal:
        shots = journal.shots(1)
    elsewhere = [told | {"on": "standing"} if at == 4 else told for at, told in enumerate(truth)]
    assert len(wrong_shots(shots, elsewhere)) == 1
    moved = [told | {"robot_target": truth[0]["robot_target"]} for told in truth[:9]]
    assert len(wrong_shots(shots[:9], moved)) >= 7
