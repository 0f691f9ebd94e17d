"""CSV files that `--excel` writes: spreadsheets open them, commands read them."""

import pytest
from paper_campaign import MECHANISM, new_campaign

from campaigns.planning.plan_file import read_plan
from campaigns.shots.joined_shots import read_joints
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots_csv import read_shots


def cells(path):
    """Cells of a file for spreadsheets, by line."""
    data = path.read_bytes()
    assert data.startswith(b"\xef\xbb\xbf")
    return [line.split(";") for line in data.decode("utf-8-sig").splitlines()]


@pytest.fixture(scope="module")
def paper(tmp_path_factory):
    campaign = new_campaign(tmp_path_factory.mktemp("sheets") / "c")
    campaign.run(pairs=20, unseen=4)
    campaign.identify()
    return campaign


def test_exported_shots_are_the_same_when_a_command_reads_them(pkmcal, paper, tmp_path):
    plain, sheet = tmp_path / "plain.csv", tmp_path / "sheet.csv"
    assert pkmcal("export", paper.folder, "--format", "shots", "--to", plain).code == 0
    ended = pkmcal("export", paper.folder, "--format", "shots", "--to", sheet, "--excel")
    assert ended.code == 0
    assert len({len(row) for row in cells(sheet)}) == 1
    assert not any("." in cell for cell in cells(sheet)[1][:8])
    assert read_shots(sheet, MECHANISM) == read_shots(plain, MECHANISM)
    refused = pkmcal("export", paper.folder, "--excel")
    assert refused.code == 2
    assert "add --format shots" in refused.error_line


def test_a_plan_and_its_programs_are_the_same(pkmcal, tmp_path):
    folder = new_campaign(tmp_path / "c").folder
    words = ("plan", folder, "--shots", "24", "--program", "csv", "--stage", "run")
    assert pkmcal(*words).code == 0
    plan, joints = folder / "plan.csv", next(folder.glob("*joints*.csv"))
    expected = read_plan(plan, MECHANISM)
    at_joints = [shot for _, shot in read_joints(joints, MECHANISM, ShotSet.IDENTIFICATION)]
    assert pkmcal(*words, "--excel").code == 0
    assert cells(plan)[0][:3] == ["shot", "set", "pair"]
    assert read_plan(plan, MECHANISM) == expected
    assert cells(joints)[0][0] == "name"
    again = [shot for _, shot in read_joints(joints, MECHANISM, ShotSet.IDENTIFICATION)]
    assert again == at_joints


def test_corrected_poses(pkmcal, paper, tmp_path):
    poses = tmp_path / "poses.csv"
    poses.write_text("name;x_mm;y_mm;z_mm;theta_deg\np;10,5;-20,25;-575;0\n", encoding="utf-8")
    ended = pkmcal("correct", paper.folder, "--poses", poses, "--excel")
    assert ended.code == 0, ended.err
    corrected = cells(tmp_path / "poses-corrected.csv")
    assert corrected[1][:4] == ["p", "10,5", "-20,25", "-575,0"]
    commanded = float(corrected[1][5].replace(",", "."))
    assert commanded == pytest.approx(10.5, abs=5.0)
