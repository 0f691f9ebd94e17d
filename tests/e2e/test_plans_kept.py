"""What a plan promises, and what comes of it when it is measured."""

import pytest
from command_line import change

AS_SIMULATED = {
    "tracker.uncertainty.along_um": 15.0,
    "tracker.uncertainty.along_um_per_m": 0.0,
    "tracker.uncertainty.across_um": 15.0,
    "tracker.uncertainty.across_um_per_m": 0.0,
}
"""The scenario's tracker, whose noise is 0.015/√3 mm on each coordinate."""


def test_identify_states_what_the_plan_foretold(pkmcal, measured):
    """The same seed gives the same plan, so it may be made again when all is measured."""
    change(measured / "campaign.yaml", AS_SIMULATED)
    foretold = pkmcal("plan", measured, "--json").document
    found = pkmcal("identify", measured, "--json").document
    stated = {name: p["std"] for name, p in found["parameters"].items() if p["free"]}
    scale = found["chi2"]["scale"]
    assert stated.keys() == foretold["predicted_std"].keys()
    for name, std in foretold["predicted_std"].items():
        assert stated[name] == pytest.approx(scale * std, rel=0.15), name
    mean_mm = foretold["position_error_mm"]["mean"]
    assert found["position_std_mm"]["mean"] == pytest.approx(scale * mean_mm, rel=0.1)


def test_run_foresees_for_a_goal_what_the_plan_was_made_for(pkmcal, planned):
    goal = ("--until", "σ=0.05")
    shots = pkmcal("plan", planned, *goal, "--candidates", "300", "--json").document["shots"]
    ended = pkmcal("run", planned, *goal, "--dry")
    assert ended.code == 0
    assert f"{shots} shots to identify from will do" in ended.out
