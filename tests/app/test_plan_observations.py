"""What `pkmcal plan` plans of other kinds of observation, and what it says of them."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
from printers import ARM, DIRECTIONS, RADIUS_MM, ROBOT, ROD_MM

from app.main import run_command
from app.new_campaign import create_simulated
from campaigns.campaign import open_campaign
from campaigns.errors import OptionsInvalid, PlanInvalid
from campaigns.options import PlanOptions
from campaigns.planning.plan_check import REFLECTOR_MOVE_S
from campaigns.settings.config import changed_settings
from campaigns.shots.observation_records import PlannedRow, append_measured
from campaigns.shots.observations_csv import read_observations
from campaigns.shots.shot_sets import ShotSet
from campaigns.workflow.planning import plan, plan_without_shots

BED = "{name: bed}"
PART = "{name: part, shrinkage_percent: 0.2, shrinkage_std_percent: 0.01}"
HALF = "{name: half 2, body: half 2, place_mm: [0, 0, 0], std_mm: 5}"


def with_objects(folder, *objects, **changed):
    keys = {"objects": f"[{', '.join(objects)}]"} | changed
    (folder / "campaign.yaml").write_text(changed_settings(folder, keys).text)
    return open_campaign(folder)


@pytest.fixture
def printer_folder(tmp_path):
    """Printer of the size of a Kossel, with a bed of 100 mm radius."""
    places = RADIUS_MM * np.stack([np.cos(DIRECTIONS), np.sin(DIRECTIONS)], axis=1)
    arms = "".join(ARM.format(x=x, y=y, rod=ROD_MM) for x, y in places)
    robot = tmp_path / "printer.yaml"
    robot.write_text(ROBOT.format(arms=arms))
    assert run_command(["new", str(tmp_path / "pr"), "--offline", "--robot", str(robot)]) == 0
    return tmp_path / "pr"


def printer_campaign(folder):
    return with_objects(folder, BED, PART, **{"space.radius_mm": "100.0"})


@pytest.fixture
def par4(tmp_path):
    create_simulated(tmp_path / "try", "par4-prototype", "paper-simulation")
    return tmp_path / "try"


def test_measured_observations_are_planned_anew_only_by_force(pkmcal, printer_folder):
    campaign = printer_campaign(printer_folder)
    path, words = campaign.path("observations.csv"), ("--shots", "0", "--observe", "bed=6")
    assert pkmcal("plan", printer_folder, *words).code == 0
    planned = path.read_bytes()
    assert pkmcal("plan", printer_folder, *words).code == 0, "nothing is measured"
    rows = read_observations(path, campaign.robot.mechanism)
    with campaign.journal() as journal:
        append_measured(journal, path.name, *measured(rows[0]))
    refused = pkmcal("plan", printer_folder, *words)
    assert refused.code == 2
    assert (
        "is the plan of observations that are measured or imported, 1 by now" in refused.error_line
    )
    assert path.read_bytes() == planned
    forced = pkmcal("plan", printer_folder, *words, "--force")
    assert forced.code == 0
    older = path.with_name("observations-older-2.csv")
    assert f"to go back to it: mv {older} {path}" in forced.err + forced.out
    assert older.read_bytes() == planned


def measured(row):
    return PlannedRow(row), replace(row, values=(0.01,))


def test_observations_alone_are_written_without_values_and_the_older_file_is_kept(
    printer_folder, capsys
):
    campaign = printer_campaign(printer_folder)
    campaign.path("observations.csv").write_text("older")
    words = ("--shots", "0", "--observe", "bed=30", "--observe", "part=12", "--for", "xy", "--json")
    capsys.readouterr()
    assert run_command(["plan", str(printer_folder), *words]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["counts"] == {"bed": 36, "part": 15}
    assert document["path"] == str(campaign.path("observations.csv"))
    assert [row["name"] for row in document["gains"]] == ["part", "bed"]
    quantities = {row["name"]: row for row in document["determined"]}
    assert (quantities["xy"]["is_determined"], quantities["xy"]["is_tested"]) == (True, True)
    assert not campaign.plan_path.exists()
    assert campaign.path("observations-older-1.csv").read_text() == "older"
    rows = read_observations(
        campaign.path("observations.csv"), campaign.robot.mechanism, ("bed", "part")
    )
    assert all(row.is_planned for row in rows)
    assert {(row.object, row.std_mm, row.std_source) for row in rows} == {
        ("bed", 0.01, "default"),
        ("part", 0.03, "default"),
    }
    held_out = [row.object for row in rows if row.purpose is ShotSet.VALIDATION]
    assert (held_out.count("bed"), held_out.count("part")) == (6, 3)
    assert {len(row.joints) for row in rows if row.object == "part"} == {2}
    # the nozzle stands on the bed, whose radius `space` limits
    joints = np.array([row.joints[0] for row in rows if row.object == "bed"])
    poses = campaign.robot.kinematics.forward(joints).values_or_raise()
    assert np.abs(poses[:, 2]).max() < 1e-6
    assert np.hypot(poses[:, 0], poses[:, 1]).max() <= 100.0


def test_heights_alone_are_said_to_lack_a_length(printer_folder, capsys):
    printer_campaign(printer_folder)
    words = ("--shots", "0", "--observe", "bed=30", "--for", "xy")
    assert run_command(["plan", str(printer_folder), *words]) == 0
    said, noted = capsys.readouterr()
    file = printer_folder / "observations.csv"
    assert f"next: pkmcal import {printer_folder} {file}" in noted
    assert "gains most per minute: 10 distances of part" in said
    assert "10 heights of bed gain next to nothing in xy" in said
    assert "a length is missing" in said
    assert re.search(r"^xy .* no +no *$", said, re.M)


def test_programs_are_of_shots(printer_folder, capsys):
    printer_campaign(printer_folder)
    words = ("--shots", "0", "--observe", "bed=30", "--program", "csv")
    assert run_command(["plan", str(printer_folder), *words]) == 2
    assert "--shots 0 plans no shots" in capsys.readouterr().err


def test_a_seed_plans_the_same_observations_again(printer_folder):
    campaign = printer_campaign(printer_folder)
    options = PlanOptions(shots=0, observe=("bed=8",))
    once, again = (plan_without_shots(campaign, options).rows for _ in range(2))
    assert once == again
    assert once != plan_without_shots(campaign, replace(options, seed=7)).rows


def test_every_second_pair_is_of_the_reflector_on_the_other_half(par4):
    usual = plan(open_campaign(par4), PlanOptions(shots=30))
    assert (usual.observations, usual.checked.reflector_moves) == (None, ())
    campaign = with_objects(par4, HALF)
    alone = plan(campaign, PlanOptions(shots=30))
    assert alone.checked.shots == usual.checked.shots
    assert alone.forecast.position_std_mm == pytest.approx(usual.forecast.position_std_mm, rel=1e-6)
    assert alone.forecast.std == pytest.approx(usual.forecast.std, rel=1e-3)
    assert alone.forecast.freedom == pytest.approx(usual.forecast.freedom)
    options = PlanOptions(shots=30, reflector=("half 2",), quantity="rotation")
    in_turn = plan(campaign, options)
    shots = campaign.read_plan()
    assert [s.reflector for s in shots] == [s.reflector for s in in_turn.checked.shots]
    counts = [sum(shot.reflector == name for shot in shots) for name in ("", "half 2")]
    assert abs(counts[0] - counts[1]) <= 4
    (move,) = in_turn.checked.reflector_moves
    assert {shot.reflector for shot in shots if shot.shot < move} == {""}
    assert {shot.reflector for shot in shots if shot.shot >= move} == {"half 2"}
    assert in_turn.checked.seconds > usual.checked.seconds + REFLECTOR_MOVE_S
    assert in_turn.forecast.shots == 30
    assert in_turn.forecast.rotation_std_deg.mean() < 0.5 * usual.forecast.rotation_std_deg.mean()
    for planned, is_tested in ((alone, False), (in_turn, True)):
        (rotation,) = (q for q in planned.observations.determined if q.name == "rotation")
        assert rotation.is_tested is is_tested
    names = [gain.name for gain in in_turn.observations.gains]
    assert sorted(names) == ["half 2", "shots"]


def test_no_move_of_the_reflector_is_hidden(par4, capsys):
    with_objects(par4, HALF)
    assert run_command(["plan", str(par4), "--shots", "30", "--reflector", "half 2"]) == 0
    assert (
        "the reflector is moved before shot 39 (half 2): 2 min of this" in capsys.readouterr().out
    )


@pytest.mark.parametrize(
    ("options", "error", "says"),
    [
        ({"shots": 0}, OptionsInvalid, "--shots 0 leaves nothing to plan"),
        (
            {"shots": 0, "observe": ("bed=30",), "until": "0.1"},
            OptionsInvalid,
            "--shots 0 plans no shots, which --until is for",
        ),
        ({"shots": 30, "reflector": ("half 3",)}, OptionsInvalid, "half 3 is no object of"),
        ({"shots": 30, "reflector": ("bed",)}, OptionsInvalid, "bed is no object of"),
        ({"shots": 30, "quantity": "flat"}, OptionsInvalid, "--for flat: nothing observes it"),
        (
            {"shots": 30, "observe": ("bed=9", "bed=8")},
            OptionsInvalid,
            "--observe bed stands twice",
        ),
        ({"shots": 30, "observe": ("bed=9",)}, PlanInvalid, "too few poses for bed"),
    ],
)
def test_what_cannot_be_planned_is_refused_and_leaves_the_older_plan(
    par4, monkeypatch, options, error, says
):
    monkeypatch.setattr("campaigns.design.pose_sampling.BATCHES", 20)  # for poses out of reach
    campaign = with_objects(par4, HALF, "{name: bed, place_mm: [0, 0, 5000]}")
    campaign.plan_path.write_text("older")
    with pytest.raises(error, match=says):
        plan(campaign, PlanOptions(**options))
    assert campaign.plan_path.read_text() == "older"
    assert not campaign.path("observations.csv").exists()


def test_objects_without_a_kind_are_not_compared(par4):
    campaign = with_objects(par4, HALF, "{name: thing}")
    gains = plan(campaign, PlanOptions(shots=30)).observations.gains
    assert sorted(gain.name for gain in gains) == ["half 2", "shots"]
