"""What `pkmcal plan` makes of options and settings, and what it says of the plan."""

import json
import math
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
from par4_space import SKEW_NAMES, SPACE

from app.main import run_command
from app.new_campaign import create_simulated
from app.plan_text import paying_line, plate_warning, told_lines, warnings
from campaigns.campaign import open_campaign
from campaigns.design.restricted_space import UNRESTRICTED, Rectangle, RestrictedSpace, Zone
from campaigns.errors import OptionsInvalid, PlanInvalid, WriteFailed
from campaigns.estimation.estimators import Model
from campaigns.estimation.information import Uncertainty
from campaigns.estimation.observability import observability
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.options import PlanOptions
from campaigns.planning.plans import Placement
from campaigns.planning.predicted_uncertainty import Forecast
from campaigns.shots.shot_sets import ShotSet
from campaigns.workflow.planning import plan


@pytest.fixture
def campaign(tmp_path):
    create_simulated(tmp_path / "try", "par4-prototype", "paper-simulation")
    return open_campaign(tmp_path / "try")


@pytest.fixture(scope="module")
def plan_of(tmp_path_factory):
    """Plan by options of a campaign that is not changed, made once."""
    folder = tmp_path_factory.mktemp("planned") / "try"
    create_simulated(folder, "par4-prototype", "paper-simulation")
    return cache(partial(plan, open_campaign(folder)))


def with_setting(campaign, old, changed):
    path = campaign.path("campaign.yaml")
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, changed))
    return open_campaign(campaign.folder)


def identification(planned):
    return [shot for shot in planned.checked.shots if shot.purpose is ShotSet.IDENTIFICATION]


def predicted(planned):
    return planned.forecast.predicted


def worst_mm(planned):
    return predicted(planned).largest("mm")


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
    for options in (PlanOptions(until="σ=0.1"), PlanOptions(placement=Placement.OPTIMAL)):
        assert asked_of(campaign, options)[0] is Placement.OPTIMAL
    for options in (None, PlanOptions()):
        assert asked_of(campaign, options)[0] is Placement.BOUNDARY
    campaign = with_setting(campaign, "placement: boundary", "placement: optimal")
    assert asked_of(campaign)[0] is Placement.OPTIMAL
    near = PlanOptions(placement=Placement.BOUNDARY)
    assert asked_of(campaign, near)[0] is Placement.BOUNDARY


def test_boundary_placement_with_a_goal_is_refused():
    with pytest.raises(OptionsInvalid, match=r"--until .* --placement boundary"):
        PlanOptions(placement=Placement.BOUNDARY, until="σ=0.1")


def test_with_a_goal_the_shots_asked_for_are_the_most_allowed(campaign, asked_of):
    _, goal = asked_of(campaign, PlanOptions(until="σ=0.05"))
    assert (goal.until_mm, goal.plan.identification_shots) == (0.05, 1000)
    _, capped = asked_of(campaign, PlanOptions(until="σ=0.05", shots=60))
    assert capped.plan.identification_shots == 60
    _, usual = asked_of(campaign)
    assert usual.identification_shots == 120


def test_a_goal_that_is_none_or_for_lengths_that_are_held_is_refused(campaign):
    with pytest.raises(OptionsInvalid, match=r"'0\.05' is not understood"):
        plan(campaign, PlanOptions(until="0.05"))
    with pytest.raises(OptionsInvalid, match=r"--fix leaves no length to find .* --shots instead"):
        plan(campaign, PlanOptions(until="σ=0.05", fix=("*_mm",)))


def test_plan_is_for_the_full_model_and_for_the_standard_one_where_shots_are_few(tmp_path, capsys):
    create_simulated(tmp_path / "h4", "h4", "drawn-robots")
    campaign = open_campaign(tmp_path / "h4")
    assert plan(campaign, PlanOptions(shots=40)).model is Model.FULL
    assert {shot.model for shot in campaign.read_plan()} == {Model.FULL}
    assert run_command(["plan", str(campaign.folder), "--shots", "10"]) == 0
    said = " ".join(capsys.readouterr().err.split())
    assert "planned for the standard model, not the full one: the shots are too few" in said
    assert {shot.model for shot in campaign.read_plan()} == {None}


@pytest.mark.slow
def test_the_data_sheet_in_the_settings_is_what_is_reckoned_with(campaign, plan_of):
    assert campaign.instrument == TrackerUncertainty.of_limits(15, 0, 15, 0)
    sharp = plan_of(PlanOptions(shots=44))
    coarse_one = campaign
    for key in ("along_um", "across_um"):
        coarse_one = with_setting(coarse_one, f"{key}: 15.0", f"{key}: 45.0")
    coarse = plan(coarse_one, PlanOptions(shots=44))
    assert worst_mm(coarse) == pytest.approx(3.0 * worst_mm(sharp), rel=1e-6)


@pytest.mark.slow
def test_parameters_held_are_not_forecast_and_leave_the_others_surer(plan_of):
    standard = PlanOptions(shots=60, model=Model.STANDARD)
    everything = plan_of(standard)
    fewer = plan_of(replace(standard, fix=("arm*.forearm_mm",)))
    assert len(predicted(fewer).names) == 18
    assert worst_mm(fewer) < worst_mm(everything)


TILTS = ("arm2.axis_tilt_deg", "arm3.axis_tilt_deg")


@pytest.mark.long
@pytest.mark.parametrize("placement", list(Placement))
def test_a_plan_for_axis_tilts_says_how_well_it_will_tell_them(plan_of, placement):
    plain = PlanOptions(shots=80, placement=placement)
    usual = plan_of(replace(plain, model=Model.STANDARD))
    tilted = plan_of(replace(plain, model=Model.FULL))
    std = predicted(tilted).std_in_file_units
    assert set(std) - set(predicted(usual).std_in_file_units) == {*TILTS, *SKEW_NAMES}
    assert all(0.001 < std[name] < 0.1 for name in (*TILTS, *SKEW_NAMES)), std


def test_a_single_pair_tells_nothing_and_is_a_plan_all_the_same(plan_of):
    forecast = plan_of(PlanOptions(shots=2)).forecast
    assert not forecast.predicted.full_rank
    assert set(forecast.seen.indices.values()) == {0.0}


@pytest.mark.slow
def test_parameters_that_nothing_tells_apart_leave_the_older_plan(campaign):
    plan(campaign, PlanOptions(shots=14))
    before = campaign.plan_path.read_text()
    for placement in Placement:
        asked = PlanOptions(shots=60, placement=placement, free=("arm0.z_mm",))
        with pytest.raises(PlanInvalid, match=r"arm0\.z_mm, .* move together.*--fix"):
            plan(campaign, asked)
    assert campaign.plan_path.read_text() == before
    assert not list(campaign.folder.glob("plan-older-*"))


@pytest.mark.slow
def test_the_document_says_how_the_plan_was_made_and_what_it_tells(campaign, capsys):
    words = ("--shots", 60, "--placement", "optimal", "--seed", 5, "--json")
    assert run_command(["plan", str(campaign.folder), *map(str, words)]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["placement"] == "optimal"
    assert document["seed"] == 5
    std = document["predicted_std"]
    worst = max(value for name, value in std.items() if name.endswith("_mm"))
    assert document["worst"]["length_mm"] == pytest.approx(worst)
    assert 0.0 < document["position_error_mm"]["mean"] < document["position_error_mm"]["max"]
    assert len(document["from_below"]) == 4
    curve = {at["shots"]: at for at in document["curve"]}
    assert curve[60]["length_mm"] == pytest.approx(worst)
    assert curve[60]["position_mm"] == pytest.approx(document["position_error_mm"]["mean"])


def test_a_plan_with_too_few_shots_is_written_and_its_document_knows_nothing(campaign, capsys):
    assert run_command(["plan", str(campaign.folder), "--shots", "12", "--json"]) == 0
    captured = capsys.readouterr()
    document = json.loads(captured.out)
    assert document["shots"] == 12
    assert set(document["predicted_std"].values()) == {None}
    assert document["worst"] == {"length_mm": None, "angle_deg": None}
    assert set(document["position_error_mm"].values()) == {None}
    assert document["curve"] is None
    assert "too few shots" in captured.err


@pytest.mark.slow
def test_what_people_read_names_the_worst_and_says_when_more_shots_stop_paying(campaign, capsys):
    picture = campaign.path("plan.svg")
    words = ("--shots", "40", "--placement", "optimal", "--plot", str(picture))
    assert run_command(["plan", str(campaign.folder), *words]) == 0
    text = capsys.readouterr().out
    for words in (
        "Predicted uncertainty",
        "worst length arm",
        "±",
        "positions in the workspace",
        "O5",
    ):
        assert words in text
    assert "40 shots, this plan" in text
    assert "only average" in text
    assert "predicted σ, mm" in picture.read_text()


def told_of(shots, names, variances):
    known = Uncertainty.of(names, SPACE.units(names), np.diag(variances), source="predicted")
    return Forecast(shots, known, np.array([0.001, 0.003]))


NOTHING_ODD = replace(
    told_of(40, ("arm1.x_mm", "arm0.joint_offset_deg"), [4e-4, 1e-8]),
    seen=observability(np.diag([12.0, 1.0])),
    from_below=(0.5, 0.5, 0.5, 0.5),
)


def test_a_joint_that_comes_from_one_side_is_warned_of():
    assert list(warnings(NOTHING_ODD)) == []
    one_sided = replace(NOTHING_ODD, from_below=(0.85, 0.9, 0.5, 0.1))
    first, second = warnings(one_sided)
    assert "joint 1 comes from smaller values to 90%" in first
    assert "joint 3 comes from larger values to 90%" in second
    assert "backlash" in second


def test_uneven_approaches_and_ratios_that_are_barely_told_are_said():
    odd = replace(NOTHING_ODD, from_below=(0.34, 0.5, 0.35, 0.7), ratio_std_ppm=140.0)
    *_, uneven, ratio = told_lines(odd)
    assert uneven == "outside 35% to 65%, backlash is determined less well: joints 0, 3"
    assert "barely determined: to ±140 ppm" in ratio
    assert len(list(told_lines(NOTHING_ODD))) == len(list(told_lines(odd))) - 2
    assert "not at all" in list(told_lines(replace(odd, ratio_std_ppm=math.inf)))[-1]


def test_the_worst_are_named_with_their_units():
    lines = list(told_lines(NOTHING_ODD))
    assert lines[0] == (
        "worst length arm1.x_mm ±0.0200 mm, worst angle arm0.joint_offset_deg ±0.0057 deg"
    )
    assert "±0.0020 mm on average, ±0.0030 mm at most" in lines[1]


def test_more_shots_stop_paying_where_they_only_average():
    curve = [
        told_of(shots, ("plate_mm",), [variance])
        for shots, variance in ((14, 1.0), (20, 0.2), (40, 0.1), (80, 0.05))
    ]
    assert paying_line(curve).startswith("beyond about 20 shots")


@pytest.mark.slow
def test_older_plans_are_kept_each_under_a_name_of_its_own(campaign):
    texts = []
    for seed in (1, 2, 3):
        plan(campaign, PlanOptions(shots=14, seed=seed))
        texts.append(campaign.plan_path.read_text())
    assert len(set(texts)) == 3
    kept = [campaign.path(f"plan-older-{number}.csv").read_text() for number in (1, 2)]
    assert kept == texts[:2]


def test_a_plan_that_cannot_be_written_leaves_the_older_one(campaign, monkeypatch):
    campaign.plan_path.write_text("older")

    def write(path, shots, mechanism):
        raise WriteFailed(f"{path}: no space", remedy="free some")

    monkeypatch.setattr("campaigns.planning.plan_file.write_plan", write)
    with pytest.raises(WriteFailed):
        plan(campaign, PlanOptions(shots=14))
    assert campaign.plan_path.read_text() == "older"
    assert not list(campaign.folder.glob("plan-older-*"))


@pytest.mark.slow
def test_where_hardly_any_pose_can_be_taken_positions_are_judged_at_the_plans_own(
    campaign, monkeypatch
):
    monkeypatch.setattr("campaigns.design.pose_sampling.BATCHES", 40)
    monkeypatch.setattr("campaigns.design.pose_sampling.WORKSPACE_POSES", 10**6)
    monkeypatch.setattr("campaigns.design.pose_sampling.FOUND", 10**6)
    planned = plan(campaign, PlanOptions(shots=44))
    assert len(planned.forecast.position_std_mm) == len(planned.checked.shots)


def test_a_plate_whose_size_nobody_said_is_warned_of():
    floor = Zone("floor", Rectangle(), (-800.0, 0.0), keeps_in=True)
    assert "space.plate_radius_mm" in plate_warning(RestrictedSpace((floor,)))
    assert plate_warning(RestrictedSpace((floor,), 100.0)) == ""
    assert plate_warning(UNRESTRICTED) == ""
