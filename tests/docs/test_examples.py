"""The examples to copy run as they stand, and find what they say they do."""

import re
import runpy

import numpy as np
import pytest
from pages import ROOT, blocks

from campaigns.errors import TargetsInvalid
from campaigns.robots.robot import find_robot, read_robot


@pytest.fixture
def example(tmp_path, monkeypatch, capsys):
    """Runs one in an empty folder: its names, and what it printed."""
    monkeypatch.chdir(tmp_path)

    def run(name):
        made = runpy.run_path(str(ROOT / "examples" / f"{name}.py"))
        return made, capsys.readouterr().out

    return run


def test_a_robot_is_identified_from_a_table_of_shots(example, tmp_path):
    made, said = example("identify")
    found, true = made["found"], made["true"]
    off = [(found.parameters[n].value - true.parameters[n]) / found.std()[n] for n in found.free]
    assert np.abs(off).max() < 4.0
    assert "<Shots: 80 (20 validation, 60 identification) of 4 joints>" in said
    assert "<IdentificationResult: pass, 22 of 29 parameters by points, hold-out 0.01" in said
    table = found._repr_html_()
    assert table.count("<tr>") == 1 + len(found.free)
    assert "<td>plate_mm</td><td>100.0000</td>" in table
    assert "hold-out pairs, after" in (tmp_path / "identify.svg").read_text()


def test_an_estimator_of_ones_own_gets_residuals_with_their_jacobian(example):
    made, _ = example("own_estimator")
    lengths = [made["identified"][f"arm{arm}.forearm_mm"] for arm in range(3)]
    nominal = made["robot"].parameters["arm0.forearm_mm"]
    np.testing.assert_allclose(np.array(lengths) - nominal, 0.5, atol=0.1)


def test_a_mechanism_of_ones_own_is_planned_and_studied(example, tmp_path):
    made, said = example("own_mechanism")
    robot = made["robot"]
    joints = robot.kinematics.inverse(made["pose"]).values_or_raise()
    np.testing.assert_allclose(robot.kinematics.forward(joints).values[0], made["pose"], atol=1e-9)
    other = made["par4"].kinematics.inverse(made["pose"]).values
    assert np.abs(joints - other).max() > 0.01
    assert "8 campaigns, 0 failed" in said
    assert (tmp_path / "plan.svg").stat().st_size > 1000


GCODE = "G21 G90 ; mm\nG0 X0 Y0 Z-575 C0\nM3 S100\nG1 X60 C5 F600 (along x)\nM2\n"


@pytest.fixture
def gcode(example, tmp_path):
    """Corrects G-code for a Par4 that is off: the program, and the two robots."""
    made, _ = example("correct_gcode")
    nominal = find_robot("par4-prototype").robot
    (tmp_path / "nominal.yaml").write_text(find_robot("par4-prototype").document.text)
    text = (tmp_path / "nominal.yaml").read_text()
    (tmp_path / "identified.yaml").write_text(text.replace("plate_mm: 100.0", "plate_mm: 101.0"))
    identified = read_robot(tmp_path / "identified.yaml").robot
    return lambda program: made["correct"](program, "identified.yaml", "nominal.yaml"), (
        identified.kinematics,
        nominal.kinematics,
    )


def test_corrected_gcode_leads_along_the_wanted_line_and_keeps_the_rest(gcode):
    correct, (identified, nominal) = gcode
    lines = correct(GCODE).splitlines()
    assert (lines[0], lines[2], lines[-1]) == ("G21 G90 ; mm", "M3 S100", "M2")
    moves = [line.split() for line in lines if line.startswith(("G0", "G1"))]
    assert [words[0] for words in moves] == ["G0", *["G1"] * 12]
    assert [words[-1] for words in moves if words[-1][0] == "F"] == ["F600"]
    unit = np.array([1.0, 1.0, 1.0, np.pi / 180.0])
    commanded = np.array([[float(word[1:]) for word in words[1:5]] for words in moves]) * unit
    there = identified.forward(nominal.inverse(commanded).values_or_raise()).values_or_raise()
    share = np.linspace(0.0, 1.0, 13)[:, None]
    wanted = [0.0, 0.0, -575.0, 0.0] + share * [60.0, 0.0, 0.0, np.radians(5.0)]
    np.testing.assert_allclose(there, wanted, atol=2e-4)
    assert np.abs(commanded - wanted)[:, :3].max() > 0.1


@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("G2 X10 I5", "line 5: G2 is not followed"),
        ("G20", "line 5: G20 is not followed"),
        ("G91", "line 5: G91 is not followed"),
        ("#1 = 5", "line 5: '#1 = 5' is no word"),
        ("G1 X1 X2", "line 5: X2 is not followed"),
        ("G1 X1 M2", "line 5: M2 beside a move"),
        ("G4 X1", "line 5: G4 beside a move"),
        ("/G1 X1", "line 5: '/G1 X1' is no word"),
        ("M98 P100", "line 5: M98 is not followed"),
    ],
)
def test_gcode_that_is_not_understood_is_refused_by_its_line(gcode, line, says):
    correct, _ = gcode
    with pytest.raises(Exception, match=re.escape(says)):
        correct(GCODE.replace("M2\n", f"{line}\n"))


def test_gcode_without_a_known_start_or_out_of_reach_is_refused(gcode):
    correct, _ = gcode
    with pytest.raises(Exception, match=r"line 1: the first move has no Y"):
        correct("G1 X0 F100\n")
    with pytest.raises(TargetsInvalid, match="out of reach"):
        correct("G1 X2000 Y0 Z-575 C0 F100\n")


@pytest.mark.parametrize("has_turn", [True, False])
def test_loops_over_corrected_poses_write_each_in_three_languages(
    has_turn, tmp_path, monkeypatch, capsys
):
    axes = ["x_mm", "y_mm", "z_mm", *(["theta_deg"] if has_turn else [])]
    head = ",".join(["name", *axes, *(f"commanded_{axis}" for axis in axes)])
    rows = ["pick,1,2,-600,30,1.5,2.5,-600.5,30", "place,0,0,0,0,4,5,-6,0"]
    if not has_turn:
        rows = ["pick,1,2,-600,1.5,2.5,-600.5", "place,0,0,0,4,5,-6"]
    (tmp_path / "targets-corrected.csv").write_text("\n".join([head, *rows, ""]))
    monkeypatch.chdir(tmp_path)
    written = []
    for block in blocks("python"):
        if block.where.startswith("docs/closed-controllers"):
            exec(compile(block.text, block.where, "exec"), {})
            moved = [line.split() for line in capsys.readouterr().out.splitlines()]
            written.append(next(words for words in moved if "1.5" in " ".join(words)))
    rapid, krl, vplus = ("".join(words) for words in written)
    half = "0,0.965925826,0.258819045,0" if has_turn else "0,1.000000000,0.000000000,0"
    assert rapid.startswith(f"MoveJ[[1.5,2.5,-600.5],[{half}],[0,0,0,0],[9E9")
    assert rapid.endswith(r"fine,tool0\WObj:=wobj0;")
    assert krl == f"PTP{{X1.5,Y2.5,Z-600.5,A{30 if has_turn else 0},B0,C180}}"
    turn = "-30.000000" if has_turn else "-0.000000"
    assert vplus == f"MOVETRANS(1.5,2.5,-600.5,0,180,{turn})"
