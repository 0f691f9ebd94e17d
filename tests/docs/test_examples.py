"""The examples to copy run as they stand, and find what they say they do."""

import runpy

import numpy as np
import pytest
from pages import ROOT


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
