"""A campaign on a stand that gives way, beside nests that do not."""

import csv
from math import dist

import pytest
from command_line import change

from sim.scenarios.scenario import shipped_text

PLACES = {"A": [900.0, 800.0, -900.0], "B": [-700.0, 900.0, -950.0], "C": [200.0, -900.0, -300.0]}
NESTS = "".join(f"    - {{name: {n}, place_mm: {mm}}}\n" for n, mm in PLACES.items())


@pytest.mark.long
def test_a_stand_that_creeps_is_named_by_as_much_as_its_nests_show_and_corrected(pkmcal, tmp_path):
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
    (stand,) = (finding for finding in found["findings"] if finding["name"] == "stand")
    assert "the tracker's stand or the robot's base moved slowly" in stand["says"]
    # the nests stand beside the robot, so that the tracker sees them move as its stand does
    assert pkmcal("export", folder, "--format", "shots").code == 0
    with (folder / "shots.csv").open(encoding="utf-8", newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["nest"]]
    points = {name: [] for name in PLACES}
    for row in rows:
        points[row["nest"]].append([float(row[axis]) for axis in ("x_mm", "y_mm", "z_mm")])
    crept_mm = max(dist(seen[0], seen[-1]) for seen in points.values())
    assert crept_mm > 0.1
    assert stand["numbers"]["mm"] == pytest.approx(crept_mm, rel=0.3)
    assert found["verdict"] == "pass"
