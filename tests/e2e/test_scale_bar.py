"""A campaign whose scale bar, between two nests, measures the tracker's scale."""

import pytest
from command_line import change

from campaigns.journal.journal import read_journal
from sim.scenarios.scenario import shipped_text

SCALE_PPM = 100.0
TRACKER = f"""tracker:
  scale_ppm: {SCALE_PPM}
  nests:
    - {{name: A, place_mm: [900.0, 800.0, -900.0]}}
    - {{name: bar-1, place_mm: [700.0, -700.0, -1000.0]}}
    - {{name: bar-2, place_mm: [-300.0, -700.0, -1000.0]}}
"""
BAR = {"name": "bar", "length_mm": 1000.0, "std_mm": 0.005, "nests": ["bar-1", "bar-2"]}


@pytest.mark.long
def test_a_bar_between_nests_names_a_scale_of_100_ppm(pkmcal, tmp_path):
    scenario = tmp_path / "nests.yaml"
    scenario.write_text(shipped_text("paper-simulation").replace("tracker:\n", TRACKER))
    folder = tmp_path / "cell"
    assert pkmcal("new", folder, "--scenario", scenario).code == 0
    change(folder / "cell.yaml", {"speed_up": 1000})
    small = {"plan.shots": 16, "plan.validation_pairs": 2}
    change(folder / "campaign.yaml", {**small, "known_lengths": [BAR]})
    assert pkmcal("plan", folder).code == 0
    assert pkmcal("run", folder, "--yes").code == 0
    with read_journal(folder / "campaign.db") as journal:
        nests = [shot.intent.nest for shot in journal.shots(1) if shot.intent.nest]
    assert nests == ["bar-1", "bar-2", "A"] * 3
    found = pkmcal("identify", folder, "--json").document
    scale_ppm, std_ppm = found["tracker"]["scale"]
    assert scale_ppm == pytest.approx(SCALE_PPM, abs=4.0 * std_ppm)
    assert std_ppm < 10.0
    assert any("the tracker's scale is off by" in finding["says"] for finding in found["findings"])
    assert found["verdict"] == "fail"
