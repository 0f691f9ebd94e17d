"""A robot at work warmer than it was measured: the set for that temperature holds, no other."""

import csv
import shutil

import pytest
from command_line import change

DRAWN_DEGC, MEASURED_DEGC, WORK_DEGC = 20.0, 45.0, 60.0
POSES = "x_mm,y_mm,z_mm,theta_deg\n0,0,-575,0\n100,-80,-600,20\n-120,90,-540,-15\n"


def warm(folder, degC):
    """Parts of the simulated robot as warm as that from the start."""
    grown = {"rise_degC": degC - DRAWN_DEGC, "time_constant_s": 0.01}
    forearms = {"ppm_per_degC": 12.0, **grown}
    thermal = {"arm_ppm_per_degC": 23.0, **grown, "forearms": forearms}
    change(folder / "cell.yaml", {"robot.thermal": thermal})
    (folder / "cell-memory.json").unlink(missing_ok=True)  # its plate stands elsewhere now


def shots_at(pkmcal, folder, degC, seed):
    """Rows of a run, planned by a seed of its own, by parts of this temperature."""
    change(folder / "campaign.yaml", {"plan.seed": seed})
    assert pkmcal("plan", folder).code == 0
    warm(folder, degC)
    assert pkmcal("run", folder, "--yes", "--anew", "--anyway").code == 0
    file = folder / f"{degC:g}.csv"
    assert pkmcal("export", folder, "--shots", "--to", file).code == 0
    rows = list(csv.DictReader(file.read_text(encoding="utf-8").splitlines()))
    for row in rows:
        row["part_temperature_degC"] = degC
        row["pair"] = str(int(row["pair"]) + 1000 * seed) if row["pair"] else ""
    return rows


def mean_distance(pkmcal, folder, *words):
    """Mean error of commanded distances after calibration, and its U, mm."""
    done = pkmcal("validate", folder, "--stage", "after", "--yes", "--anyway", "--json", *words)
    each = done.document["requirements"][0]
    assert each["name"] == "distances, mean error"
    return each["error_mm"], each["expanded_uncertainty_mm"]


@pytest.mark.long
def test_a_set_for_the_temperature_of_work_validates_to_the_noise(pkmcal, planned, tmp_path):
    robot = shutil.copytree(planned, tmp_path / "robot")
    rows = shots_at(pkmcal, planned, DRAWN_DEGC, 1) + shots_at(pkmcal, planned, MEASURED_DEGC, 2)
    with (tmp_path / "both.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    assert pkmcal("import", robot, tmp_path / "both.csv").code == 0
    found = pkmcal("identify", robot, "--model", "auto", "--json").document
    assert found["warmth"]["source"] == "temperature"
    warm(robot, WORK_DEGC)
    degC, file = str(WORK_DEGC), robot / "robot-compensated.yaml"
    (tmp_path / "poses.csv").write_text(POSES)
    correct = ("correct", robot, "--poses", tmp_path / "poses.csv", "--overwrite", "--to")
    assert pkmcal("export", robot).code == 0
    assert pkmcal("load", robot, "--yes").code == 0
    cold_mm, _ = mean_distance(pkmcal, robot)
    assert pkmcal(*correct, tmp_path / "by-words.csv", "--temperature", degC).code == 0
    assert pkmcal("export", robot, "--temperature", degC, "--overwrite").code == 0
    assert pkmcal("load", robot, "--yes").code == 0
    warm_mm, u_mm = mean_distance(pkmcal, robot)
    assert warm_mm < u_mm < cold_mm
    assert warm_mm < 0.3 * cold_mm
    assert pkmcal(*correct, tmp_path / "by-file.csv").code == 0
    by_words, by_file = (
        [row[:-1] for row in csv.reader((tmp_path / name).read_text("utf-8").splitlines())]
        for name in ("by-words.csv", "by-file.csv")  # but for σ, which a warm file does not have
    )
    assert by_words == by_file
    assert pkmcal("load", robot, "--rollback", "--yes").code == 0
    assert pkmcal("load", robot, "--rollback", "--yes").code == 0
    targets_mm, u_mm = mean_distance(pkmcal, robot, "--by", "targets")
    assert targets_mm < u_mm
