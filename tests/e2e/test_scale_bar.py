"""A campaign whose scale bar, between two nests, shows that the tracker's scale is off."""

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
    small = {"plan.shots": 16, "plan.validation_pairs": 2, "settle.timeout_s": 300}
    change(folder / "campaign.yaml", {**small, "known_lengths": [BAR]})
    assert pkmcal("plan", folder).code == 0
    assert pkmcal("run", folder, "--yes").code == 0
    with read_journal(folder / "campaign.db") as journal:
        nests = [shot.intent.nest for shot in journal.shots(1) if shot.intent.nest]
    assert nests == ["bar-1", "bar-2", "A"] * 3
    found = pkmcal("identify", folder, "--model", "standard", "--json").document
    scale = found["known_lengths"]["scale"]
    assert scale["share"] * 1e6 == pytest.approx(SCALE_PPM, abs=4e6 * scale["std"])
    assert "known-length" in {doubt["name"] for doubt in found["doubts"]}
    assert found["verdict"] == "fail"
