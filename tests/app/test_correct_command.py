"""`pkmcal correct`: targets of files, and what is refused."""

import csv
import shutil

import numpy as np
import pytest
from paper_campaign import NOMINAL, PaperCampaign

from campaigns.robots.robot import read_robot

POSES = "name,x_mm,y_mm,z_mm,theta_deg\npick,100,0,-600,10\nplace,-120.5,80,-550,-20\n"


@pytest.fixture
def folder(whole: PaperCampaign, tmp_path):
    return shutil.copytree(whole.folder, tmp_path / "paper")


@pytest.fixture
def correct(folder, pkmcal):
    return lambda *words: pkmcal("correct", folder, *words)


@pytest.fixture
def poses(tmp_path):
    path = tmp_path / "targets.csv"
    path.write_text(POSES, encoding="utf-8")
    return path


def test_poses_with_what_to_command_beside_them(correct, poses, folder):
    ended = correct("--poses", poses, "--json")
    assert ended.code == 0
    document, written = ended.document, poses.with_name("targets-corrected.csv")
    assert (document["path"], document["poses"]) == (str(written), 2)
    assert document["next"] == f"pkmcal report {folder}"
    assert 0.1 < document["correction_mm"]["mean"] <= document["correction_mm"]["max"] < 10.0
    assert 0.0 < document["position_std_mm"] < 0.02
    rows = list(csv.DictReader(written.read_text(encoding="utf-8").splitlines()))
    assert [row["name"] for row in rows] == ["pick", "place"]
    identified = read_robot(folder / "robot-compensated.yaml").robot.kinematics
    columns = ("x_mm", "y_mm", "z_mm", "theta_deg")
    unit = np.array([1.0, 1.0, 1.0, np.pi / 180.0])
    wanted = np.array([[float(row[each]) for each in columns] for row in rows]) * unit
    commanded = np.array([[float(row[f"commanded_{each}"]) for each in columns] for row in rows])
    joints = NOMINAL.robot.kinematics.inverse(commanded * unit).values_or_raise()
    there = identified.forward(joints).values_or_raise()
    np.testing.assert_allclose(there, wanted, atol=5e-6)
    for row, pose, other in zip(rows, wanted, commanded * unit, strict=True):
        size = np.linalg.norm((other - pose)[:3])
        assert float(row["correction_mm"]) == pytest.approx(size, abs=2e-6)
        assert 1e-4 < float(row["position_std_mm"]) < 0.02
        turned = np.degrees(other[3] - pose[3])
        assert float(row["correction_theta_deg"]) == pytest.approx(turned, abs=2e-6)


def test_a_set_that_no_identification_found_has_no_uncertainty(correct, poses, folder, tmp_path):
    text = (folder / "robot-compensated.yaml").read_text(encoding="utf-8")
    changed = tmp_path / "other.yaml"
    lines = [line for line in text.splitlines() if not line.startswith("sha256")]
    changed.write_text("\n".join(lines).replace("z_mm: 0.0", "z_mm: 0.01", 1), encoding="utf-8")
    unknown = correct("--poses", poses, "--robot", changed, "--json")
    assert unknown.code == 0
    assert unknown.document["position_std_mm"] is None
    written = poses.with_name("targets-corrected.csv").read_text(encoding="utf-8")
    assert all(line.endswith(",") for line in written.splitlines()[1:])


@pytest.mark.parametrize(
    ("row", "says"),
    [
        ("far,2000,0,-600,0", "targets.csv:4: far: out of reach"),
        (",0,0,-575,60", "targets.csv:4: theta 60.000° outside [-45°, 45°]"),
        ("x,0,0,,0", "targets.csv:4: z_mm is empty"),
    ],
)
def test_poses_that_cannot_be_taken_are_refused_by_their_line(correct, poses, row, says):
    poses.write_text(f"{POSES}{row}\n", encoding="utf-8")
    refused = correct("--poses", poses)
    assert (refused.code, refused.out) == (2, "")
    assert says in refused.error_line
    assert not poses.with_name("targets-corrected.csv").exists()


def test_without_an_exported_set_the_identified_one_counts(correct, folder, poses):
    assert correct("--poses", poses, "--to", folder / "a.csv").code == 0
    (folder / "robot-compensated.yaml").unlink()
    assert correct("--poses", poses, "--to", folder / "b.csv").code == 0
    assert (folder / "a.csv").read_text() == (folder / "b.csv").read_text()


@pytest.mark.slow
def test_a_set_of_another_nominal_robot_is_refused(correct, folder, poses):
    path = folder / "robot.yaml"
    text = path.read_text(encoding="utf-8").replace("plate_mm: 100.0", "plate_mm: 100.5")
    path.write_text(text, encoding="utf-8")
    code, _, err = correct("--poses", poses)
    assert code == 2
    assert "rests on another nominal robot" in err
