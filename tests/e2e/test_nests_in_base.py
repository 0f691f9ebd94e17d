"""A campaign on a stand that gives way, beside nests that do not."""

import pytest
from command_line import change

from sim.scenarios.scenario import shipped_text

PLACES = {"A": [900.0, 800.0, -900.0], "B": [-700.0, 900.0, -950.0], "C": [200.0, -900.0, -300.0]}
NESTS = "".join(f"    - {{name: {n}, place_mm: {mm}}}\n" for n, mm in PLACES.items())


@pytest.mark.long
def test_nests_tell_of_a_stand_that_creeps(pkmcal, tmp_path):
    scenario, folder = tmp_path / "creep.yaml", tmp_path / "cell"
    text = shipped_text("paper-simulation").replace("tracker:\n", f"tracker:\n  nests:\n{NESTS}")
    text = text.replace("station: {", "station: {creep_mm_per_h: [3.0, -4.0, 0.0], ")
    assert "creep" in text
    scenario.write_text(text)
    assert pkmcal("new", folder, "--scenario", scenario).code == 0
    change(folder / "cell.yaml", {"speed_up": 1000})
    often = {"plan.drift_shots": 9}  # a loaded computer's cell does not work evenly in time
    change(folder / "campaign.yaml", {"plan.shots": 60, "plan.validation_pairs": 10, **often})
    assert pkmcal("plan", folder).code == 0
    assert pkmcal("run", folder, "--yes").code == 0
    found = pkmcal("identify", folder, "--json").document
    changes = [finding for finding in found["findings"] if finding["name"] == "change"]
    assert changes
    assert any("tracker's stand" in finding["says"] for finding in changes)
    assert found["verdict"] == "fail"
