"""The whole chain, command by command and as one dry run, on a small cell."""

import re
from pathlib import Path

import pytest
from command_line import Keyboard, change, contents
from par4_space import SPACE
from ruamel.yaml import YAML

from campaigns import assessment
from campaigns.campaign import Campaign
from sim.scenarios.scenario import load_scenario

NEXT = {"schema", "next", "before_next", "next_reason"}
IDENTIFICATION_KEYS = {
    *("schema", "model", "converged", "iterations", "parameters", "undetermined", "scatter"),
    *("sizes", "tracker", "residuals_mm", "unseen_mm", "fitted", "unseen", "modelled"),
    *("events", "determined", "diagnosis", "layers", "excluded", "covariance", "motions"),
    *("correlations", "position_std_mm", "budget", "region"),
    *("hold_out", "findings", "frame", "sessions", "reference_degC", "posterior"),
    *("verdict", "reasons", "obstacles", "seconds"),
    *("series", "shots", "observations", "asked", "robot_digest", "plan_digest"),
    *("journal_digest", "journal_records", "at_utc", "settings", "pedigree"),
}
DRY_RUN_KEYS = {
    *NEXT,
    *("scenario", "seed", "before", "after", "identification", "parameter_file", "report"),
    "seconds",
}
VALIDATION_KEYS = {
    *("distances_mm", "rotation_mm", "straightness_mm", "repeatability", "frame_mm", "iso9283")
}


def assert_is_validation(document):
    assert set(document) == VALIDATION_KEYS
    assert set(document["distances_mm"]) == {"mean_abs", "max_abs"}
    assert set(document["straightness_mm"]) == {"x", "y", "z"}
    assert set(document["repeatability"]) == {"radius_mm", "rp_mm", "approaches"}
    assert set(document["frame_mm"]) == {"mean", "max"}
    assert document["rotation_mm"] > 0.0


def assert_is_identification(document):
    assert set(document) - NEXT - {"ways"} == IDENTIFICATION_KEYS - NEXT
    assert document["schema"] == "pkmcal/identification/2"
    assert tuple(document["parameters"])[: len(SPACE.names)] == SPACE.names
    for entry in document["parameters"].values():
        assert set(entry) == {"nominal", "value", "delta", "std", "free", "group"}
    for errors in (document["residuals_mm"], document["unseen_mm"]):
        for stage in (errors["before"], errors["after"]):
            assert set(stage) == {"mean_abs", "rms", "max_abs"}


@pytest.fixture
def gathered(monkeypatch) -> list[Path]:
    """Folders in the order in which they are read to be evaluated."""
    folders: list[Path] = []

    def counting(campaign: Campaign) -> assessment.Evidence:
        folders.append(campaign.folder)
        return gather(campaign)

    gather = assessment.gather
    monkeypatch.setattr(assessment, "gather", counting)
    return folders


def test_a_dry_run_finds_the_errors_and_proves_the_gain(pkmcal, planned, gathered):
    limits = load_scenario("paper-simulation").acceptance.model_dump()
    # as many shots as σ of positions needs to be decided by these limits
    change(planned / "campaign.yaml", {"acceptance": limits, "plan.shots": 36})
    assert pkmcal("plan", planned).code == 0
    gathered.clear()
    ended = pkmcal("dry-run", planned, "--json")
    assert ended.code == 0, ended.err
    document = ended.document
    assert set(document) == DRY_RUN_KEYS
    # after each validation, before the export, and for report, verdict and next step together
    assert len(gathered) == 4
    assert (document["scenario"], document["seed"]) == ("paper-simulation", 1)
    assert Path(document["report"]).read_text(encoding="utf-8").startswith("<!DOCTYPE html>")
    assert_is_identification(document["identification"])
    assert_is_validation(document["before"])
    assert_is_validation(document["after"])
    assert document["before"]["distances_mm"]["mean_abs"] > 1.0
    assert document["after"]["distances_mm"]["max_abs"] < 0.1
    assert document["after"]["frame_mm"]["max"] < 0.1
    assert document["after"]["rotation_mm"] < 0.1 * document["before"]["rotation_mm"]
    assert document["parameter_file"] == str(planned / "robot-compensated.yaml")
    assert "7/8 validate after" in ended.err
    assert "calibration improved accuracy" in ended.err
    page = Path(document["report"]).read_text(encoding="utf-8")
    assert '<p class="decision">Pass</p>' in page
    assert "Simulated cell: no real robot was measured." in page


@pytest.mark.long
def test_a_dry_run_whose_fit_is_not_good_loads_nothing(pkmcal, planned):
    change(planned / "campaign.yaml", {"plan.validation_pairs": 0})
    ended = pkmcal("dry-run", planned, "--json")
    assert ended.code == 1, "nothing shows that the result holds elsewhere"
    assert ended.document["identification"]["verdict"] == "not decided"
    assert ended.document["after"] is None
    assert ended.document["parameter_file"] is None
    assert not list(planned.glob("controller-before-*"))


def test_a_dry_run_touches_no_real_devices_and_goes_on_with_nobodys_campaign(pkmcal, measured):
    before = contents(measured)
    refused = pkmcal("dry-run", measured)
    assert refused.code == 2
    assert "has measurements already" in refused.error_line
    refused = pkmcal("dry-run", measured, "--seed", 4)
    assert refused.code == 2
    assert "seed of its own" in refused.error_line
    assert contents(measured) == before
    change(measured / "campaign.yaml", {"controller.url": "tcp://127.0.0.1:9"})
    refused = pkmcal("dry-run", measured)
    assert refused.code == 2
    assert "real devices" in refused.error_line


def test_a_second_run_has_nothing_to_do(pkmcal, measured):
    before = (measured / "campaign.db").read_bytes()
    ended = pkmcal("run", measured, "--yes", "--json")
    assert ended.code == 0
    assert (ended.document["series"], ended.document["shots"]) == (1, 33)
    assert "all of the plan is measured" in ended.err
    assert (measured / "campaign.db").read_bytes() == before


@pytest.mark.long
def test_a_run_told_to_begin_anew_measures_all_again_and_says_where_the_tracker_stands(
    pkmcal, tiny
):
    assert pkmcal("run", tiny, "--yes").code == 0
    x, y, z = YAML(typ="safe").load(tiny / "campaign.yaml")["tracker"]["place_mm"]
    change(tiny / "campaign.yaml", {"tracker.place_mm": [x + 1600.0, y, z]})
    ended = pkmcal("run", tiny, "--yes", "--anew", "--json")
    assert ended.code == 0
    assert (ended.document["series"], ended.document["shots"]) == (2, 10)
    assert "1.6 m off; correct tracker.place_mm" in ended.err


def test_identify_says_it_as_people_and_as_programs_want_it(pkmcal, measured):
    ended = pkmcal("identify", measured, "--fix", "plate_mm", "--json")
    assert_is_identification(ended.document)
    plate = ended.document["parameters"]["plate_mm"]
    assert (plate["delta"], plate["free"], plate["std"]) == (0.0, False, None)
    ended = pkmcal("identify", measured)
    assert ended.code == 0
    assert ended.out.startswith("verdict: pass\n")
    assert "pkmcal export" in ended.err


def test_a_tolerance_that_the_robot_is_far_outside_of_is_not_good(pkmcal, measured):
    narrow = [word for name in ("arm*.*_mm", "plate_mm") for word in ("--prior", f"{name}=0.02")]
    ended = pkmcal("identify", measured, *narrow, "--json")
    assert ended.code == 1
    assert ended.document["verdict"] == "fail"
    assert "beyond-tolerance" in {finding["name"] for finding in ended.document["findings"]}
    refused = pkmcal("export", measured)
    assert refused.code == 1
    assert "verdict is 'fail'" in refused.error_line
    assert not (measured / "robot-compensated.yaml").exists()


def test_nothing_comes_of_nothing(pkmcal, planned):
    for command in ("identify", "export", "check-journal"):
        ended = pkmcal(command, planned)
        assert ended.code == 2
        assert "nothing has been measured yet" in ended.error_line
    assert not (planned / "campaign.db").exists()


def test_without_a_terminal_nothing_moves_unless_told(pkmcal, exported):
    before = contents(exported)
    for words in ("run --anew", "load", "validate --stage before"):
        name, *options = words.split()
        ended = pkmcal(name, exported, *options)
        assert ended.code == 2
        assert "--yes" in ended.error_line
    memory = {"cell-memory.json": None}  # the simulated controller was asked what it holds
    assert contents(exported) | memory == before | memory


def test_the_question_says_what_will_move_and_with_which_devices(pkmcal, planned, monkeypatch):
    monkeypatch.setattr("sys.stdin", Keyboard("n\n"))
    refused = pkmcal("run", planned)
    assert refused.code == 2
    devices = "50 % speed, controller SIM-C-0001, tracker 390001"
    question = rf"33 shots, about \d\d s, {devices}\. Is the cell clear\? \[y/N\] "
    assert re.search(question, refused.err)
    assert not (planned / "campaign.db").exists()


def test_one_test_alone_needs_no_plan_and_a_missed_limit_before_is_only_stated(
    pkmcal, planned, gathered
):
    (planned / "plan.csv").unlink()
    command = ("validate", planned, "--stage", "before", "--only", "rotation", "--yes")
    ended = pkmcal("--verbose", *command, "--json")
    assert ended.code == 0, ended.err
    assert len(gathered) == 1, "figures, verdict and next step are of one evaluation"
    assert ended.document["rotation_mm"] > 0.0
    assert ended.document["distances_mm"] is None
    assert "SIM-C-0001" in ended.err
    assert "settling rotation 2" in ended.err
    change(planned / "campaign.yaml", {"acceptance.rotation_mm": 0.001})
    refused = pkmcal(*command)
    assert refused.code == 2
    assert "--stage before: measured already (series 1): rotation;" in refused.error_line
    ended = pkmcal(*command, "--force")
    assert ended.code == 0
    assert ended.out.startswith("before calibration, errors are only stated; 1 of the limits")
    assert re.search(r"rotation .* 0\.001 .* fail", ended.out)
    assert "settling" not in ended.err


@pytest.mark.parametrize("tracker", ["emscon", "pointline"])
def test_devices_says_who_is_there(pkmcal, planned, tracker):
    change(planned / "campaign.yaml", {"tracker.driver": tracker})
    document = pkmcal("devices", planned, "--json").document
    assert document["controller"]["serial"] == "SIM-C-0001"
    assert document["tracker"]["reflectors"] == ["CCR-1.5in", "CCR-75mm"]
    assert "CCR-1.5in, CCR-75mm" in pkmcal("devices", planned).out
