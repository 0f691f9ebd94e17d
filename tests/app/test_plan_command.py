"""What `pkmcal plan` makes of options and settings, and what it says of the plan."""

import json
from dataclasses import replace

import numpy as np
import pytest
from paper_campaign import MECHANISM, new_campaign
from par4_space import SPACE

from app.main import run_command
from app.new_campaign import create_simulated
from app.plan_text import warnings
from campaigns.assessment import Evaluation, evaluate
from campaigns.campaign import open_campaign
from campaigns.errors import OptionsInvalid, PlanInvalid
from campaigns.evidence import gather
from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.next_step import next_step, state_of
from campaigns.options import PlanOptions
from campaigns.planning import optimal_plan
from campaigns.planning.forecast import Forecast
from campaigns.planning.plan_file import plan_digest, write_plan
from campaigns.planning.plans import Placement
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots_csv import ShotRow
from campaigns.workflow.importing import import_shots
from campaigns.workflow.next_hint import next_hint
from campaigns.workflow.planning import plan

PLAN_KEYS = {
    *("schema", "next", "before_next", "next_reason"),
    *("shots", "pairs", "placement", "seed", "until_mm", "predicted_std"),
    *("position_std_mm", "rotation_std_deg"),
    *("weakest", "from_below", "fitting_lines_mm", "space", "seconds_estimated"),
    *("path", "older", "programs", "repeats", "reflector_moves", "observations"),
}


@pytest.fixture(autouse=True)
def few_candidates(monkeypatch):
    """Fewer candidates: choosing among all of them takes seconds."""
    monkeypatch.setattr(optimal_plan, "CANDIDATES", 400)


@pytest.fixture
def campaign(tmp_path):
    create_simulated(tmp_path / "try", "par4-prototype", "paper-simulation")
    return open_campaign(tmp_path / "try")


def with_setting(campaign, old, changed):
    path = campaign.path("campaign.yaml")
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, changed))
    return open_campaign(campaign.folder)


def identification(planned):
    return [shot for shot in planned.checked.shots if shot.purpose is ShotSet.IDENTIFICATION]


class AskedError(Exception):
    """Carries what a planner was asked for, instead of a plan."""


@pytest.fixture
def asked_of(monkeypatch):
    """Gives who is asked to place the poses, and for what, instead of a plan."""

    def asked(placement):
        def planner(robot, view, request, rng):
            raise AskedError(placement, request)

        return planner

    planning = "campaigns.workflow.planning"
    monkeypatch.setattr(f"{planning}.make_optimal_plan", asked(Placement.OPTIMAL))
    monkeypatch.setattr(f"{planning}.make_plan", asked(Placement.BOUNDARY))

    def ask(campaign, options=None):
        with pytest.raises(AskedError) as caught:
            plan(campaign, options)
        return caught.value.args

    return ask


def test_placement_is_by_option_or_setting_and_optimal_where_shots_are_chosen(campaign, asked_of):
    for options in (PlanOptions(until="0.1"), PlanOptions(placement=Placement.OPTIMAL)):
        assert asked_of(campaign, options)[0] is Placement.OPTIMAL
    for options in (None, PlanOptions()):
        assert asked_of(campaign, options)[0] is Placement.BOUNDARY
    campaign = with_setting(campaign, "placement: boundary", "placement: optimal")
    assert asked_of(campaign)[0] is Placement.OPTIMAL
    near = PlanOptions(placement=Placement.BOUNDARY)
    assert asked_of(campaign, near)[0] is Placement.BOUNDARY
    with pytest.raises(OptionsInvalid, match=r"--until .* --placement boundary"):
        PlanOptions(placement=Placement.BOUNDARY, until="0.1")


def test_with_a_goal_the_shots_asked_for_are_the_most_allowed(campaign, asked_of):
    _, goal = asked_of(campaign, PlanOptions(until="0.05"))
    assert (goal.until_mm, goal.plan.identification_shots) == (0.05, 1000)
    _, capped = asked_of(campaign, PlanOptions(until="0.05", shots=60))
    assert capped.plan.identification_shots == 60
    _, usual = asked_of(campaign)
    assert usual.identification_shots == 120


def test_the_data_sheet_in_the_settings_is_what_is_planned_with(campaign, asked_of):
    campaign = with_setting(campaign, "across_um: 15.0", "across_um: 45.0")
    _, request = asked_of(campaign, PlanOptions(until="0.05"))
    sheet = TrackerUncertainty.of_limits(15, 0, 45, 0)
    uncertainty = request.uncertainty
    assert (uncertainty.along_mm, uncertainty.across_mm) == (sheet.along_mm, sheet.across_mm)


def test_shots_that_place_no_frame_are_refused_and_leave_the_older_plan(campaign):
    campaign.plan_path.write_text("older")
    with pytest.raises(PlanInvalid, match="place no frame of the tracker"):
        plan(campaign, PlanOptions(shots=2))
    assert campaign.plan_path.read_text(encoding="utf-8") == "older"


@pytest.mark.slow
def test_the_document_says_how_the_plan_was_made_and_what_it_will_give(campaign, capsys):
    campaign.plan_path.write_text("older")
    words = ("--until", 0.1, "--shots", 60, "--seed", 5, "--json")
    assert run_command(["plan", str(campaign.folder), *map(str, words)]) == 0
    document = json.loads(capsys.readouterr().out)
    assert set(document) == PLAN_KEYS
    assert campaign.path("plan-older-1.csv").read_text(encoding="utf-8") == "older"
    assert document["path"] == str(campaign.plan_path)
    assert 4 < document["shots"] == 2 * document["pairs"] <= 60
    assert (document["placement"], document["seed"], document["until_mm"]) == ("optimal", 5, 0.1)
    assert 0.0 < document["position_std_mm"]["mean"] < document["position_std_mm"]["max"]
    assert document["position_std_mm"]["mean"] < 0.1
    assert 20.0 < document["seconds_estimated"] < 600.0
    std = document["predicted_std"]
    length, angle = document["weakest"]
    assert length["std"] == max(v for name, v in std.items() if SPACE[name].unit == "mm")
    assert angle["unit"] == "deg"
    assert len(document["from_below"]) == 4
    now, doubled = document["repeats"]
    assert (doubled["visits"], now["seconds"]) == (2 * now["visits"], 0.0)
    assert 0.0 < doubled["seconds"] < document["seconds_estimated"]
    assert doubled["scatter_std"] < now["scatter_std"] < 0.3
    assert doubled["shown_share"] < now["shown_share"] < 0.8


def test_what_people_read_names_prior_noise_and_the_weakest(campaign, capsys):
    picture = campaign.path("plan.svg")
    words = ("--shots", "20", "--plot", str(picture))
    assert run_command(["--verbose", "plan", str(campaign.folder), *words]) == 0
    text = " ".join(capsys.readouterr().out.split())
    for words in (
        "prior: every source",
        "noise: the tracker's",
        "positions in the workspace ±",
        "visits of the drift pose: scatter known to ±",
    ):
        assert words in text
    assert "weakest: arm" in text
    assert picture.exists()


NOTHING_ODD = Forecast(
    40,
    {"arm1.x_mm": 0.02, "arm2.x_mm": 0.01, "arm0.joint_offset_deg": 0.0057},
    {"arm1.x_mm": "mm", "arm2.x_mm": "mm", "arm0.joint_offset_deg": "deg"},
    np.array([0.001, 0.003]),
    (0.5, 0.5, 0.5, 0.5),
    80.0,
)


def test_a_joint_that_comes_from_one_side_is_warned_of():
    assert list(warnings(NOTHING_ODD)) == []
    one_sided = replace(NOTHING_ODD, from_below=(0.85, 0.9, 0.5, 0.1))
    first, second = warnings(one_sided)
    assert "joint 1 comes from smaller values to 90%" in first
    assert "joint 3 comes from larger values to 90%" in second
    assert "backlash" in second


def test_a_measured_plan_is_replaced_only_by_force_which_says_how_to_go_back(pkmcal, tmp_path):
    paper = new_campaign(tmp_path / "c")
    paper.run(6, 2)
    measured = paper.campaign.plan_path.read_bytes()
    refused = pkmcal("plan", paper.folder, "--shots", "12")
    assert refused.code == 2
    assert "plan.csv is the plan of series 1, 18 shots of which are measured" in refused.error_line
    assert "--force plans anew" in refused.error_line
    assert paper.campaign.plan_path.read_bytes() == measured
    forced = pkmcal("plan", paper.folder, "--shots", "12", "--force", "--json")
    assert forced.code == 0, forced.err
    older = paper.folder / "plan-older-1.csv"
    assert forced.document["older"] == str(older)
    assert f"to go back to it: mv {older} {paper.campaign.plan_path}" in forced.err
    assert older.read_bytes() == measured
    (check, *_) = evaluate(open_campaign(paper.folder)).checks
    assert check.holds is False
    assert check.detail.endswith("plan-older-1.csv is: rename it to plan.csv")
    older.rename(paper.campaign.plan_path)
    assert evaluate(open_campaign(paper.folder)).checks[0].holds


def measured_by_plan(paper, how):
    """Measure something that may rest on plan.csv, or surely does not."""
    shots = paper.plan(6, 2)
    write_plan(paper.campaign.plan_path, shots, MECHANISM)
    if how in {"before", "check"}:
        named = ShotSet.VALIDATION if how == "before" else ShotSet.CHECK
        at_plan = [s for s in shots if s.purpose is ShotSet.VALIDATION]
        paper.measure(how, [replace(s, shot=n, purpose=named) for n, s in enumerate(at_plan)])
    elif how == "import":
        joints = np.array([s.joints for s in shots[1:-1]]) + 1e-3  # as encoders read them
        points = paper.campaign.robot.kinematics.forward(joints).values_or_raise()[:, :3] + 300.0
        rows = [
            ShotRow(s.pair, tuple(q), tuple(point), s.purpose)
            for s, q, point in zip(shots[1:-1], joints.tolist(), points.tolist(), strict=True)
        ]
        import_shots(paper.campaign, rows)
    else:
        paper.validate("before", frozenset({ShotSet.REPEATABILITY}))


@pytest.mark.parametrize(
    ("how", "says"),
    [
        ("before", "is the plan of series 1, 4 shots of which are measured (stage before)"),
        ("check", "is the plan of series 1, 4 shots of which are measured (stage check)"),
        ("import", "may be the plan of series 1, 16 shots that were imported"),
        ("repeatability", ""),
    ],
)
def test_a_plan_by_which_anything_was_measured_is_replaced_only_by_force(
    pkmcal, tmp_path, how, says
):
    paper = new_campaign(tmp_path / "c")
    measured_by_plan(paper, how)
    before = paper.campaign.plan_path.read_bytes()
    ended = pkmcal("plan", paper.folder, "--shots", "12")
    assert (ended.code, says in ended.err) == (2 if says else 0, True)
    if says:
        assert paper.campaign.plan_path.read_bytes() == before
        ended = pkmcal("plan", paper.folder, "--shots", "12", "--force")
    assert ended.code == 0
    older = paper.folder / "plan-older-1.csv"
    assert f"to go back to it: mv {older} {paper.campaign.plan_path}" in ended.err + ended.out
    assert older.read_bytes() == before


def test_the_hint_to_plan_anew_has_the_force_that_it_needs(tmp_path):
    for how, forced in (("before", True), ("repeatability", False)):
        paper = new_campaign(tmp_path / how)
        measured_by_plan(paper, how)
        state = replace(state_of(Evaluation(gather(paper.campaign))), misplaced="elsewhere")
        assert next_hint(paper.campaign, state).text.endswith(" --force") is forced


def test_a_plan_keeps_the_options_that_hints_repeat(tmp_path):
    paper = new_campaign(tmp_path / "c")
    options = PlanOptions(shots=12, fix=("arm*.x_mm",))
    digest = plan_digest(plan(paper.campaign, options).checked.shots, MECHANISM)
    evidence = gather(paper.campaign)
    assert evidence.plan_options == ("--shots", "12", "--fix", "arm*.x_mm")
    assert evidence.plan_digest == digest, "options make no other plan"
    step = next_step(replace(state_of(Evaluation(evidence)), misplaced="elsewhere"))
    assert step.text == f"pkmcal plan {paper.folder} --shots 12 --fix 'arm*.x_mm'"
