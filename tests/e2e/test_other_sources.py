"""Shots handed on, and a known length measured beside them: through the commands."""

import pytest
from command_line import change


@pytest.fixture
def shots(pkmcal, measured):
    """The measured campaign's shots as a file."""
    ended = pkmcal("export", measured, "--format", "shots")
    assert ended.code == 0, ended.err
    return measured / "shots.csv"


def test_shots_handed_on_and_taken_in_give_the_same_parameters(pkmcal, measured, shots, tmp_path):
    first = pkmcal("identify", measured, "--json").document["parameters"]
    other = tmp_path / "other"
    assert pkmcal("new", other).code == 0
    swapped = tmp_path / "swapped.csv"
    text = shots.read_text(encoding="utf-8")
    swapped.write_text(text.replace("q0_deg,q1_deg", "q1_deg,q0_deg", 1), encoding="utf-8")
    refused = pkmcal("import", other, swapped)
    assert refused.code == 2
    assert "swapped.csv: the joints seem to stand in the order q1, q0" in refused.error_line
    assert pkmcal("import", other, shots).code == 0
    second = pkmcal("identify", other, "--json").document["parameters"]
    # files have six decimals, and a fit ends within 0.1 σ of its minimum
    for name, entry in first.items():
        close = 0.05 * entry["std"] if entry["std"] else 1e-6
        assert second[name]["value"] == pytest.approx(entry["value"], abs=close)


def test_a_bar_measured_beside_the_robot_tells_the_trackers_scale(pkmcal, shots, tmp_path):
    other, bars = tmp_path / "other", tmp_path / "bars.csv"
    assert pkmcal("new", other).code == 0
    assert pkmcal("import", other, shots).code == 0
    places = [(x, y, z) for y in (-300.0, 300.0) for z in (-200.0, 200.0) for x in (2000.0, 3000.1)]
    lines = [f"{row // 2},,,,,{x},{y},{z},known-length" for row, (x, y, z) in enumerate(places)]
    head = "pair,q0_deg,q1_deg,q2_deg,q3_deg,x_mm,y_mm,z_mm,set"
    bars.write_text("\n".join([head, *lines]) + "\n", encoding="utf-8")
    assert pkmcal("import", other, bars).code == 0
    untold = pkmcal("identify", other)
    assert untold.code == 2
    assert "belongs to no length of known_lengths" in untold.error_line
    bar = {"name": "bar 12", "length_mm": 1000.0, "std_mm": 0.005}
    change(other / "campaign.yaml", {"known_lengths": [bar]})
    found = pkmcal("identify", other, "--json")
    assert found.code == 1
    assert found.document["next"] == f"pkmcal import {other} {shots.name} --force", "set right"
    assert found.document["series"] == 1, "the robot's shots, and the bar's beside them"
    assert found.document["tracker"]["scale"][0] == pytest.approx(100.0, rel=0.05)
    assert any("scale is off by +100" in reason for reason in found.document["reasons"])
