"""What single commands decide before any device is asked."""

import json
import os
import shutil

import pytest

from app import new_campaign
from app.cli.dry_run import prepare_campaign
from app.console import Terminal
from campaigns.campaign import open_campaign
from campaigns.controllers.load import keep
from campaigns.errors import OutputExists
from campaigns.measuring.session import RunResult
from campaigns.robots.robot import states_reflector
from sim.scenarios.scenario import load_scenario

CONTROLLER, TRACKER = "tcp://192.168.0.10:5020", "tcp://192.168.0.1:700"


def test_new_for_a_real_cell(pkmcal, tmp_path):
    folder = tmp_path / "cell-3"
    words = ("new", folder, "--controller", CONTROLLER, "--tracker", TRACKER, "--json")
    code, out, err = pkmcal(*words)
    assert code == 0
    assert json.loads(out) == {
        "schema": "pkmcal/new/1",
        "next_reason": None,
        "folder": str(folder),
        "controller": CONTROLLER,
        "tracker": TRACKER,
        "next": f"pkmcal plan {folder}",
        "before_next": "look through campaign.yaml (tracker.place_mm!); "
        f"`pkmcal devices {folder}` asks both devices",
    }
    assert "tracker.place_mm" in err
    made = open_campaign(folder)
    assert made.config.name == "cell-3"
    assert made.config.tracker.reflector == new_campaign.DEFAULT_REFLECTOR
    assert not made.is_simulated
    assert sorted(path.name for path in folder.iterdir()) == ["campaign.yaml", "robot.yaml"]


def test_new_offline_leads_to_a_plan_and_what_needs_devices_says_what_to_do_instead(
    pkmcal, tmp_path
):
    folder = tmp_path / "cell-5"
    made = pkmcal("new", folder, "--offline", "--json")
    assert made.document["controller"] == made.document["tracker"] == "offline"
    assert made.document["next"] == f"pkmcal plan {folder}"
    assert sorted(path.name for path in folder.iterdir()) == ["campaign.yaml", "robot.yaml"]
    for words in (
        ("run", folder, "--dry"),
        ("devices", folder),
        ("validate", folder, "--stage", "before"),
        ("load", folder, "--robot", folder / "robot.yaml"),
    ):
        refused = pkmcal(*words)
        assert refused.code == 2, words
        assert f"{folder} is an offline campaign" in refused.error_line
        assert f"`pkmcal import {folder} FILE`" in refused.error_line
    assert pkmcal("new", tmp_path / "other", "--offline", "--tracker", TRACKER).code == 2


@pytest.mark.parametrize(
    ("words", "hints"),
    [
        (("--robot", "par4-protoype"), ["par4-prototype"]),
        (("--scenario", "realistc"), ["realistic"]),
        (
            ("--controller", CONTROLLER, "--tracker", "http://tracker"),
            ["tracker.url", "http://tracker", "tcp://HOST:PORT"],
        ),
    ],
)
def test_new_with_an_unknown_name_or_address_makes_nothing(pkmcal, tmp_path, words, hints):
    refused = pkmcal("new", tmp_path / "try", *words)
    assert refused.code == 2
    assert all(hint in refused.error_line for hint in hints)
    assert not (tmp_path / "try").exists()


def test_a_dry_run_has_its_scenarios_limits_and_a_controller_that_computes_all(tmp_path):
    made = prepare_campaign(tmp_path / "try", "paper-prototype", None, "delta")
    cell = load_scenario(str(tmp_path / "try" / "cell.yaml"))
    assert made.config.acceptance.model_dump() == cell.acceptance.model_dump()
    assert made.config.acceptance.distance_mean_mm == 0.6
    assert cell.controller.computes_plate_tilt
    assert cell.controller.computes_transmission
    assert cell.robot.kind.name == "delta"


@pytest.mark.parametrize(
    ("scenario", "limits"),
    [("paper-simulation", (15.0, 0.0, 15.0, 0.0)), ("realistic", (10.0, 0.3, 15.0, 6.0))],
)
def test_new_plans_by_what_the_simulated_tracker_is_like(tmp_path, scenario, limits):
    tracker = new_campaign.create_simulated(tmp_path / "try", "par4-prototype", scenario).tracker
    *figures, data_sheet, typed_by = tracker.uncertainty.model_dump().values()
    assert tuple(figures) == limits
    assert (data_sheet, typed_by) == ("simulated tracker of cell.yaml", "pkmcal")


@pytest.mark.parametrize(
    ("typed", "limits", "place"),
    [
        (
            ["0.1", "x", "0,3 mm", "", "20 -30", "20, -30 -45.5 mm"],
            (0.1, 0.3),
            (20.0, -30.0, -45.5),
        ),
        (["", "", "", ""], (None, None), None),
    ],
)
def test_new_for_a_real_cell_asks_for_limits_and_the_reflector(
    pkmcal, tmp_path, monkeypatch, typed, limits, place
):
    answers = iter(typed)
    monkeypatch.setattr(Terminal, "prompt", lambda _: lambda _question: next(answers))
    words = ("new", tmp_path / "cell-3", "--controller", CONTROLLER, "--tracker", TRACKER)
    assert pkmcal(*words).code == 0
    campaign = open_campaign(tmp_path / "cell-3")
    made = campaign.config.acceptance
    assert (made.distance_mean_mm, made.distance_max_mm) == limits
    assert states_reflector(campaign.nominal) is (place is not None)
    assert campaign.robot.mechanism.plate.reflector_mm == (place or (0.0, 0.0, 0.0))
    assert list(answers) == []


SOURCE = ("Acme data sheet 3, 2024", "A. Bee")


@pytest.mark.parametrize(
    ("typed", "limits"),
    [
        (["Acme LT5", "8,0.4", "8,0.4,12,5", *SOURCE], [8.0, 0.4, 12.0, 5.0, *SOURCE]),
        (["Acme LT5", "8,0.4,12,5", SOURCE[0], "", ""], [10.0, 0.3, 15.0, 6.0, "", ""]),
    ],
)
def test_new_asks_for_the_tracker_and_who_took_its_limits_from_where(
    pkmcal, tmp_path, monkeypatch, typed, limits
):
    answers = iter(["", "", *typed, ""])
    monkeypatch.setattr(Terminal, "prompt", lambda _: lambda _question: next(answers))
    assert pkmcal("new", tmp_path / "cell-3", "--offline").code == 0
    config = open_campaign(tmp_path / "cell-3").config
    assert config.instruments.tracker == "Acme LT5"
    assert [*config.tracker.uncertainty.model_dump().values()] == limits
    assert list(answers) == []


def test_new_takes_the_tracker_by_options_with_its_source_or_not_at_all(pkmcal, tmp_path):
    limits = ("--tracker-limits", "8,0.4,12,5")
    source = ("--data-sheet", SOURCE[0], "--typed-by", SOURCE[1])
    made = pkmcal("new", tmp_path / "a", "--offline", "--tracker-name", "Acme", *limits, *source)
    assert made.code == 0, made.err
    stated = open_campaign(tmp_path / "a").config.tracker.uncertainty
    assert [*stated.model_dump().values()] == [8.0, 0.4, 12.0, 5.0, *SOURCE]
    refused = pkmcal("new", tmp_path / "b", "--offline", *limits, *source[:2])
    assert "--typed-by missing" in refused.error_line
    refused = pkmcal("new", tmp_path / "b", *limits, *source)
    assert "a simulated cell states its own" in refused.error_line
    refused = pkmcal("new", tmp_path / "b", "--offline", "--tracker-limits", "8,1", *source)
    assert "not four numbers" in refused.err


def test_new_takes_the_reflector_as_an_option_and_asks_no_more(pkmcal, tmp_path, monkeypatch):
    answers = iter(["", "", ""])
    monkeypatch.setattr(Terminal, "prompt", lambda _: lambda _question: next(answers))
    words = ("new", tmp_path / "cell-3", "--offline", "--reflector", "-20,30,1.5")
    assert pkmcal(*words).code == 0
    assert open_campaign(tmp_path / "cell-3").robot.tolerances == {"reflector_mm": 3.0}
    refused = pkmcal("new", tmp_path / "cell-4", "--offline", "--reflector", "20,30")
    assert refused.code == 2
    assert "'20,30' is no place" in refused.err


def test_new_does_not_replace_somebodys_cell(tmp_path):
    (tmp_path / "cell.yaml").write_text("mine")
    with pytest.raises(OutputExists, match=r"cell\.yaml already exists"):
        new_campaign.create_simulated(tmp_path, "par4-prototype", "realistic")
    assert (tmp_path / "cell.yaml").read_text() == "mine"
    assert not (tmp_path / "campaign.yaml").exists()


@pytest.fixture
def campaign(tmp_path):
    new_campaign.create_simulated(tmp_path / "try", "par4-prototype", "paper-simulation")
    return open_campaign(tmp_path / "try")


def test_what_the_controller_held_is_kept_under_the_next_free_number(campaign):
    held = dict(campaign.nominal.robot.parameters)
    assert keep(campaign.folder, campaign.nominal, held).name == "controller-before-1.yaml"
    campaign.path("controller-before-9.yaml").write_text("")
    campaign.path("controller-before-x.yaml").write_text("")
    latest = keep(campaign.folder, campaign.nominal, held | {"plate_mm": 101.25})
    assert latest.name == "controller-before-10.yaml"
    assert "plate_mm: 101.25" in latest.read_text()


@pytest.mark.parametrize("command", ["export", "check"])
def test_a_result_that_must_not_be_used_is_a_document_too(pkmcal, whole, tmp_path, command):
    folder = shutil.copytree(whole.folder, tmp_path / "another")
    text = (folder / "robot.yaml").read_text().replace("plate_mm: 100.0", "plate_mm: 100.5")
    (folder / "robot.yaml").write_text(text)
    ended = pkmcal(command, folder, "--json")
    assert ended.code == 1
    problem, _, remedy = ended.error_line.partition(" → ")
    error = {"problem": problem, "remedy": remedy, "exit_code": 1}
    assert ended.document == {"schema": "pkmcal/error/1", "error": error}


def test_folder_whose_name_is_no_utf_8_holds_a_campaign(tmp_path, pkmcal):
    folder = tmp_path / os.fsdecode(b"M\374ller")
    ended = pkmcal("new", folder, "--scenario", "paper-simulation", "--json")
    assert ended.code == 0, ended.err
    assert r"\x4d\xfc\x6c" in ended.document["next"]
    assert pkmcal("status", folder, "--json").document["name"] == "M?ller"


@pytest.mark.slow
def test_a_run_after_which_the_robot_has_changed_ends_with_code_1(pkmcal, tmp_path, monkeypatch):
    folder = tmp_path / "try"
    prepare_campaign(folder, "paper-prototype", None)
    assert pkmcal("plan", folder, "--shots", "20").code == 0
    changed = "at the end reference poses differ by up to 1.999 mm: the robot has changed"
    for text, code in (("", 0), (changed, 1)):
        ran = RunResult(2, 40, 0, None, None, changed=text)
        monkeypatch.setattr("app.cli.run.find_measured", lambda *_, ran=ran: ran)
        answer = pkmcal("run", folder, "--yes")
        assert answer.code == code
        assert (f"not good: {changed}" in answer.out) is bool(text)
        assert pkmcal("run", folder, "--json").document["changed"] == text


def test_a_cell_by_hand_gets_a_plan_of_an_hour_at_most(pkmcal, tmp_path):
    folder = tmp_path / "cell-9"
    assert pkmcal("new", folder, "--controller", "by-hand", "--tracker", "file:p.txt").code == 0
    plan = open_campaign(folder).config.plan
    stops = plan.shots + plan.drift_shots + 3 * 2 * plan.validation_pairs
    assert stops <= 60
    campaign = open_campaign(folder)
    assert 20 < campaign.pace.seconds(stops, 0.0) / 60 < 60
    code, out, err = pkmcal("validate", folder, "--stage", "before", "--dry")
    assert (code, "'before': distances; nothing" in out) == (0, True)
    assert "--only rotation" in err
    code, out, _ = pkmcal("devices", folder)
    assert (code, f"{folder / 'p.txt'}, not there yet" in out.replace("\n", "")) == (0, True)
