"""Somebody follows the page on own mechanisms alone: from its two files to corrected poses."""

import csv
import re

import numpy as np
import pytest
from pages import ROOT, blocks

from campaigns.errors import ConfigInvalid
from campaigns.robots.program import Program, trust
from pkmcal import find_robot

PAGE = "docs/how-to/own-mechanism.md"
PYTHON, OWN_DELTA, *_ = [
    block.text
    for block in blocks("python")
    if block.where.startswith(PAGE) and block.text.startswith("#")
]
(TRIED,) = (
    block.text
    for block in blocks("python")
    if block.where.startswith(PAGE) and not block.text.startswith("#")
)
(ROBOT,) = (block.text for block in blocks("yaml") if block.where.startswith(PAGE))
MOST_LINES = 40
STD_MM = 0.01


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the page's two files."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "biglide.py").write_text(PYTHON, encoding="utf-8")
    (tmp_path / "biglide.yaml").write_text(ROBOT, encoding="utf-8")
    trust(Program.read(tmp_path / "biglide.py"))  # as the page's `pkmcal trust` does
    return tmp_path


def code_of(text):
    return [line for line in text.splitlines() if line.strip() and not line.startswith("#")]


@pytest.mark.parametrize(
    "text", [PYTHON, *((ROOT / "examples" / f"{n}.py").read_text() for n in ("own_mechanism",))]
)
def test_a_mechanism_takes_forty_lines_and_imports_pkmcal_alone(text):
    mechanism = text.partition("# %% [markdown]\n# In a robot file")[0]
    assert len(code_of(mechanism)) <= MOST_LINES + 12 * ("# %%" in text)  # its imports, a line each
    imported = set(re.findall(r"^(?:from|import) (\w+)", text, re.MULTILINE))
    assert imported == {"numpy", "pkmcal"}


def test_a_serial_arm_takes_sixty_lines_and_imports_pkmcal_alone():
    text = (ROOT / "examples/serial_arm.py").read_text(encoding="utf-8")
    assert len(code_of(text)) <= 60
    imported = set(re.findall(r"^(?:from|import) (\w+)", text, re.MULTILINE))
    assert imported == {"numpy", "scipy", "pkmcal"}


def test_the_page_s_robot_is_planned_and_studied(folder, capsys):
    exec(compile(TRIED, PAGE, "exec"), {})
    said = capsys.readouterr().out
    assert "<Plan: " in said
    assert "8 campaigns, 0 failed" in said


def crossing(values, joints):
    """The lower crossing (N, 2) of two circles about the carriages, without pkmcal."""
    left, right = (
        np.column_stack([values[f"{arm}.x_mm"] + values[f"{arm}.joint_offset_mm"] + q,
                         np.full(len(q), values[f"{arm}.y_mm"])])
        for arm, q in zip(("arm0", "arm1"), joints.T, strict=True)
    )  # fmt: skip
    first, second = values["arm0.forearm_mm"], values["arm1.forearm_mm"]
    between = right - left
    apart = np.linalg.norm(between, axis=1)
    ahead = (apart**2 + first**2 - second**2) / (2.0 * apart)
    aside = np.sqrt(first**2 - ahead**2)
    unit = between / apart[:, None]
    return left + ahead[:, None] * unit + aside[:, None] * np.c_[unit[:, 1], -unit[:, 0]]


def test_faults_of_an_author_are_told_in_a_line(folder):
    for line, wrong, words in (
        ("x**2 + y**2 - fields", "np.abs(x + 1j * y) ** 2 - fields", "loses the imaginary part"),
        ("x**2 + y**2 - fields", "np.hypot(x, y) ** 2 - fields", "'hypot' not supported"),
        ('"lengths"', '"lenghts"', "lenghts, which is no group of error sources"),
        ('"joint_offset_mm"', '"offset_mm"', "have no joint_offset_mm for joint 0"),
        ("return x + np", "return x[:, :1]  # np", "first_joints returns the shape"),
        ("** 2) / (2.0", "** 2)[..., :1]  # (2.0", "misfit of the first"),
        ("return (x**2", "return np.hstack([x[..., :1], x[..., 1:]])  # (x", "must be (2, 1, 2)"),
        ("return (x**2", "return (x + y) * [1, 2]  # (x", "leaves a motion of the platform free"),
        ('("prismatic", "prismatic")', '("prismatic", "screw")', "'screw' for joint 1, must be"),
        ('BIGLIDE = Biglide("biglide")', "raise SystemExit(3)", "gives no mechanism"),
    ):
        assert line in PYTHON
        text, robot = PYTHON.replace(line, wrong), ROBOT
        if "offset" in wrong:
            robot = ROBOT.replace("joint_offset_mm", "offset_mm")
        (folder / "biglide.py").write_text(text, encoding="utf-8")
        (folder / "biglide.yaml").write_text(robot, encoding="utf-8")
        trust(Program.read(folder / "biglide.py"))
        with pytest.raises(ConfigInvalid) as raised:
            find_robot("biglide.yaml")
        assert words in str(raised.value), line
        assert "\n" not in str(raised.value)


@pytest.mark.slow
def test_the_page_s_robot_goes_through_a_campaign(folder, pkmcal):
    """Measured by other equations; the identified robot is within its σ everywhere."""
    assert pkmcal("new", "c", "--robot", "biglide.yaml", "--offline").code == 0
    planned = pkmcal("plan", "c", "--shots", "40")
    assert planned.code == 0, planned.err
    text = (folder / "c" / "plan.csv").read_text(encoding="utf-8")
    assert "z_mm" not in text.partition("\n")[0]
    shots = [row for row in csv.DictReader(text.splitlines()) if row["set"] != "drift"]
    robot, rng = find_robot("biglide.yaml"), np.random.default_rng(1)
    true = {name: value + rng.normal(0.0, 0.5) for name, value in robot.parameters.items()}
    joints = np.array([[float(row["q0_mm"]), float(row["q1_mm"])] for row in shots])
    places = np.c_[crossing(true, joints), np.zeros(len(joints))]
    points = places + np.array([900.0, 300.0, -200.0]) + rng.normal(0.0, STD_MM, places.shape)
    table = ["set,pair,q0_mm,q1_mm,x_mm,y_mm,z_mm"]
    table += [
        ",".join([row["set"], row["pair"], *(f"{value:.6f}" for value in [*q, *point])])
        for row, q, point in zip(shots, joints, points, strict=True)
    ]
    (folder / "measured.csv").write_text("\n".join(table) + "\n", encoding="utf-8")
    imported = pkmcal("import", "c", "measured.csv")
    assert imported.code == 0, imported.err
    identified = pkmcal("identify", "c")
    assert identified.code == 0, (identified.out, identified.err)
    assert pkmcal("export", "c").code == 0
