"""Files that cannot be used: one line that names the place, exit code 2, and nothing is touched."""

import pytest
from command_line import change, contents

HEADER = "pair,q0_deg,q1_deg,q2_deg,q3_deg,x_mm,y_mm,z_mm"
SHOT = "1,0,0,0,0,1000.5,-20.25,300"


def test_a_folder_without_a_campaign(pkmcal, tmp_path):
    ended = pkmcal("plan", tmp_path)
    assert ended.code == 2
    assert "holds no campaign.yaml" in ended.error_line
    assert "pkmcal new" in ended.error_line
    assert contents(tmp_path) == {}


def test_a_folder_that_is_not_there(pkmcal, tmp_path):
    ended = pkmcal("run", tmp_path / "nowhere", "--yes")
    assert ended.code == 2
    assert "nowhere" in ended.error_line
    assert contents(tmp_path) == {}


@pytest.mark.parametrize(
    ("file", "line", "named"),
    [
        ("campaign.yaml", "plan: [1, 2\n", ["campaign.yaml:", "is not YAML"]),
        ("campaign.yaml", "trackr: {}\n", ["campaign.yaml:", "trackr", "did you mean tracker?"]),
        ("cell.yaml", "speedup: 3\n", ["cell.yaml", "speedup", "speed_up"]),
        ("robot.yaml", "geometri: 3\n", ["robot.yaml:", "geometri", "did you mean geometry?"]),
    ],
)
def test_a_file_with_a_wrong_line(pkmcal, planned, file, line, named):
    with (planned / file).open("a") as appended:
        appended.write(line)
    assert_refused(pkmcal("run", planned, "--yes"), planned, named)


@pytest.mark.parametrize(
    ("file", "settings", "named"),
    [
        ("campaign.yaml", {"plan.shots": "many"}, ["plan.shots", '"many"', "whole number"]),
        ("campaign.yaml", {"plan.shots": 7}, ["plan.shots", "7", "multiple of 2"]),
        ("campaign.yaml", {"settle.time_s": -1.0}, ["settle.time_s", "-1", "at least 0"]),
        ("campaign.yaml", {"settle.time_ms": 200}, ["time_ms", "write time_s"]),
        ("campaign.yaml", {"tracker.url": "192.168.0.1"}, ["tracker.url", "tcp://HOST:PORT"]),
        ("campaign.yaml", {"tracker.reflector": None}, ["tracker.reflector", "missing"]),
        ("campaign.yaml", {"controller.driver": "acme"}, ["driver", "acme", "robotline"]),
        ("robot.yaml", {"geometry.arms.2.arm_mm": -350.0}, ["arms[2].arm_mm", "-350", "above 0"]),
        ("robot.yaml", {"geometry.arms.1.forearm_m": 0.7}, ["forearm_m", "write forearm_mm"]),
        ("robot.yaml", {"geometry.arms.0.x_mm": "left"}, ["arms[0].x_mm", "left", "number"]),
        ("robot.yaml", {"geometry.arms.3": None}, ["geometry.arms"]),
        ("robot.yaml", {"schema": "pkmcal/robot/9"}, ["schema", "newer", "update"]),
    ],
)
def test_a_file_with_a_wrong_value(pkmcal, planned, file, settings, named):
    change(planned / file, settings)
    assert_refused(pkmcal("plan", planned), planned, [file, *named])


def test_a_campaign_without_its_robot(pkmcal, planned):
    (planned / "robot.yaml").unlink()
    assert_refused(pkmcal("run", planned, "--yes"), planned, ["robot.yaml"])


def assert_refused(ended, folder, named):
    """Exit code 2, one line with all these words, and nothing was measured."""
    assert ended.code == 2, ended.err
    for word in named:
        assert word in ended.error_line
    assert not (folder / "campaign.db").exists()


def edited_plan(folder, edit):
    lines = (folder / "plan.csv").read_text().splitlines()
    first_pair = next(n for n, line in enumerate(lines) if ",identification," in line)
    lines[first_pair] = edit(lines[first_pair])
    text = "\n".join(line for line in lines if line)
    (folder / "plan.csv").write_text(text + "\n")
    return first_pair + 1


def lifted_by_a_metre(row):
    cells = row.split(",")
    cells[5] = str(float(cells[5]) + 1000.0)
    return ",".join(cells)


@pytest.mark.parametrize(
    ("edit", "named"),
    [
        (lambda row: lifted_by_a_metre(row), ["shot "]),
        (lambda _: "", ["pair", "one"]),
        (lambda row: row.replace(".", ",", 1), ["columns"]),
        (lambda row: row.replace(row.split(",")[3], "left", 1), ["left"]),
    ],
)
def test_an_edited_plan_is_checked_before_anything_moves(pkmcal, planned, edit, named):
    edited_plan(planned, edit)
    before = contents(planned)
    ended = pkmcal("run", planned, "--yes")
    assert_refused(ended, planned, named)
    assert contents(planned) == before


def test_a_run_without_a_plan(pkmcal, planned):
    (planned / "plan.csv").unlink()
    assert_refused(pkmcal("run", planned, "--yes"), planned, ["plan.csv", "pkmcal plan"])


def test_a_broken_plan_can_be_made_anew_and_stays_beside_it(pkmcal, planned):
    (planned / "plan.csv").write_text("nonsense")
    assert pkmcal("plan", planned).code == 0
    assert (planned / "plan-older-1.csv").read_text() == "nonsense"
    assert pkmcal("run", planned, "--dry").code == 0


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("pair,q0_deg,q1_deg,q2_deg,x_mm,y_mm,z_mm\n1,0,0,0,1,2,3\n", ["q3_deg"]),
        (f"{HEADER}\n1,0,0,zero,0,1,2,3\n{SHOT}\n", [":2", "q2_deg", "zero"]),
        (f"{HEADER}\n{SHOT}\n1,0,0,0,0,nan,2,3\n", [":3", "x_mm", "nan"]),
        (f"{HEADER}\n{SHOT}\n", [":2", "pair 1"]),
        (f"{HEADER}\n{SHOT}\n1,0,0,0,0,1000,5,-20,3\n", [":3"]),
        (f"{HEADER.replace(',', ';')}\n{SHOT.replace(',', ';').replace('.', ',')}\n", [":1"]),
        ("", ["empty", "q0_deg"]),
        (f"{HEADER}\n", ["holds no shots"]),
    ],
)
def test_a_shots_file_that_cannot_be_used(pkmcal, planned, tmp_path, text, named):
    file = tmp_path / "shots.csv"
    file.write_text(text)
    before = contents(planned)
    assert_refused(pkmcal("import", planned, file), planned, ["shots.csv", *named])
    assert contents(planned) == before


def test_a_shots_file_that_is_not_there(pkmcal, planned, tmp_path):
    ended = pkmcal("import", planned, tmp_path / "shots.csv")
    assert_refused(ended, planned, ["shots.csv"])
