"""Robots of six axes, in a plane, and with joints of both kinds: offline, by hints alone."""

import csv

import numpy as np
import pytest
from any_axes import Imagined, robot_file
from command_line import SMALL_TESTS, change
from scipy.spatial.transform import Rotation

SMALL = {"plan.validation_pairs": 6, **SMALL_TESTS}
TARGETS = {
    "hexapod": (
        "name,x_mm,y_mm,z_mm,a_deg,b_deg,c_deg",
        "middle,0,0,-550,0,0,0",
        "aside,50,20,-560,10,-3,5",
    ),
    "five-bar": ("name,x_mm,y_mm", "middle,0,300", "aside,50,250"),
    "polar": ("name,x_mm,y_mm,z_mm", "middle,300,0,0", "aside,350,50,20"),
}
POSE_COLUMNS = {
    "hexapod": ["x_mm", "y_mm", "z_mm", "rx_deg", "ry_deg", "rz_deg"],
    "five-bar": ["x_mm", "y_mm"],
    "polar": ["x_mm", "y_mm", "z_mm"],
}


def rows_of(path):
    return list(csv.DictReader(path.read_text(encoding="utf-8").splitlines()))


def planned(pkmcal, tmp_path, name, shots):
    """A campaign with its plan."""
    folder = tmp_path / "campaign"
    file = robot_file(tmp_path, name)
    assert pkmcal("new", folder, "--robot", file, "--offline").code == 0
    change(folder / "campaign.yaml", SMALL)
    assert pkmcal("plan", folder, "--shots", shots).code == 0
    return folder


@pytest.mark.parametrize("name", TARGETS)
def test_robot_goes_from_plan_to_report(pkmcal, tmp_path, name):
    folder, robot = planned(pkmcal, tmp_path, name, 30), Imagined(name)
    ended = pkmcal("plan", folder, "--program", "csv")
    assert ended.code == 0, ended.err
    columns = POSE_COLUMNS[name]
    poses = [each for each in rows_of(folder / "plan.csv")[0] if each[0] in "xyzr"]
    assert poses == columns
    assert [c for c in rows_of(folder / "program-run.csv")[0] if c[0] in "xyzr"] == columns
    before = robot.measured(folder / "program-before.csv", tmp_path / "before.csv")
    assert pkmcal("import", folder, before, "--stage", "before").code == 0
    shots = robot.measured(folder / "plan.csv", tmp_path / "shots.csv")
    assert pkmcal("import", folder, shots).code == 0
    found = pkmcal("identify", folder, "--json")
    assert found.document["verdict"] == "pass"
    assert found.document["position_std_mm"]["max"] < 0.05
    unit = " and " if name == "polar" else (" mm per joint", "′ per joint")[name == "five-bar"]
    assert unit in found.document["scatter"]["says"]
    assert pkmcal("export", folder).code == 0
    targets = tmp_path / "targets.csv"
    targets.write_text("\n".join(TARGETS[name]) + "\n", encoding="utf-8")
    turns = ("--turns", "zyx") if name == "hexapod" else ()
    assert pkmcal("correct", folder, "--poses", targets, *turns).code == 0
    check_corrected(rows_of(tmp_path / "targets-corrected.csv"), columns)
    for words in (("plan", "--program", "csv", "--stage", "after"), ("status",), ("history",)):
        assert pkmcal(words[0], folder, *words[1:]).code == 0
    assert pkmcal("report", folder).code in {0, 1}
    page = (folder / "report.html").read_text(encoding="utf-8")
    for axis in ("x", "y", "z", "rx", "ry", "rz", "θ"):
        named = axis in {column.partition("_")[0] for column in columns}
        assert (f">against {axis}</text>" in page) is named


def check_corrected(rows, columns):
    """Correction of a turn is the turn between wanted and commanded ones."""
    named = [column for column in rows[0] if column.startswith("commanded_")]
    assert named == [f"commanded_{column}" for column in columns]
    turned = [column for column in columns if column.startswith("r")]
    assert ("correction_rotation_deg" in rows[0]) is bool(turned)
    if not turned:
        return
    wanted = Rotation.from_euler("ZYX", [10.0, -3.0, 5.0], degrees=True)
    written = np.array([float(rows[1][column]) for column in turned])
    np.testing.assert_allclose(np.radians(written), wanted.as_rotvec(), atol=1e-9)
    commanded = np.radians([float(rows[1][f"commanded_{column}"]) for column in turned])
    between = (Rotation.from_rotvec(commanded) * wanted.inv()).magnitude()
    assert float(rows[1]["correction_rotation_deg"]) == pytest.approx(np.degrees(between), abs=2e-6)


def test_turns_of_unknown_order_are_asked_for_or_refused(pkmcal, tmp_path, monkeypatch):
    folder = planned(pkmcal, tmp_path, "hexapod", 8)
    shots = Imagined("hexapod").measured(folder / "plan.csv", tmp_path / "shots.csv")
    head, *lines = shots.read_text(encoding="utf-8").splitlines()
    text = "\n".join([f"{head},a_deg,b_deg,c_deg", *(f"{line},1,2,3" for line in lines)])
    shots.write_text(text + "\n", encoding="utf-8")
    refused = pkmcal("import", folder, shots)
    assert refused.code == 2
    assert "may be turns in several orders" in refused.error_line
    assert "--turns xyz|zyx|quaternion|vector" in refused.error_line
    asked = []
    monkeypatch.setattr(
        "app.console.Terminal.prompt", lambda _: lambda text: asked.append(text) or "zyx"
    )
    assert pkmcal("import", folder, shots).code == 0
    assert "in which order are its turns: xyz, zyx, quaternion, vector?" in asked[0]


def test_turns_of_a_robot_without_three_are_refused(pkmcal, tmp_path):
    folder = planned(pkmcal, tmp_path, "five-bar", 8)
    shots = Imagined("five-bar").measured(folder / "plan.csv", tmp_path / "shots.csv")
    refused = pkmcal("import", folder, shots, "--turns", "zyx")
    assert refused.code == 2
    assert "platforms with three turns" in refused.error_line


def test_length_below_zero_is_refused_with_its_line(pkmcal, tmp_path):
    file = robot_file(tmp_path, "polar", quantity="length")
    refused = pkmcal("new", tmp_path / "campaign", "--robot", file, "--offline")
    assert refused.code == 2
    assert "polar.yaml:6: geometry.arms[0].aside_mm is -40.0, must be above 0" in refused.error_line
