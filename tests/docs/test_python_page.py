"""The Python page's examples run as they stand; so does the calibration in thirty lines."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pages import ROOT, blocks

import pkmcal
from campaigns.fit.fit import fit_model
from campaigns.identification.observations import error_model, observations_of
from campaigns.identification.options import IdentificationOptions
from pkmcal import identify

EXAMPLES = [
    block for block in blocks("python") if block.where.startswith("docs/reference/python.md")
]
SHOTS = ROOT / "tests" / "data" / "vectors" / "table1-tracker-noise.csv"


def test_every_public_name_is_on_the_page_and_has_a_docstring():
    page = (ROOT / "docs/reference/python.md").read_text(encoding="utf-8")
    missing = [name for name in pkmcal.__all__ if f"`{name}" not in page]
    assert missing == []
    assert [name for name in pkmcal.__all__ if not getattr(pkmcal, name).__doc__] == []


@pytest.mark.long
def test_examples_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    shutil.copy(SHOTS, Path("shots.csv"))
    for block in EXAMPLES:
        exec(compile(block.text, block.where, "exec"), {})
        assert capsys.readouterr().out, f"{block.where} says nothing"


def test_calibration_in_thirty_lines_finds_what_identify_finds(tmp_path, monkeypatch, capsys):
    """`identify` estimates some micrometres of scatter beside the tracker's noise as well.

    Its σ are averaged over what the sizes may be, so that they are larger.
    """
    (block,) = (
        block
        for block in blocks("python")
        if block.where.startswith("docs/explanation/how-it-works")
    )
    code = [line for line in block.text.splitlines() if line and "import" not in line]
    assert len(code) <= 40
    monkeypatch.chdir(tmp_path)
    shutil.copy(SHOTS, Path("shots.csv"))
    ran = {}
    exec(compile(block.text, block.where, "exec"), ran)
    shots, stated_mm2 = ran["shots"], ran["tracker_std_mm"] ** 2 * np.eye(3)
    alike = replace(shots, stated_covariance_mm2=np.tile(stated_mm2, (len(shots), 1, 1)))
    robot = ran["robot"].kinematics
    near = robot.forward(alike.joints, approach=alike.approach).values
    options = IdentificationOptions()
    model = error_model(robot, alike, options)
    fitted = fit_model(model, observations_of(alike, near, options))
    # the lines have no scatter of the robot, which weighs products of tilts and places otherwise
    assert (np.abs(ran["x"] - fitted.x) < 0.5 * fitted.std).all()
    is_linear = ran["groups"] != "reflector"
    assert ran["std"][is_linear] == pytest.approx(fitted.std[is_linear], rel=0.15)
    theirs = identify(alike, ran["robot"])
    std = np.sqrt(np.diag(theirs.uncertainty.posterior.covariance))
    assert (np.abs(ran["x"] - theirs.uncertainty.posterior.mean) < 0.5 * std).all()
    assert (ran["std"] < 1.05 * std)[is_linear].all()
    for group, size in theirs.uncertainty.posterior.sizes.items():
        assert ran["size"][ran["groups"] == group][0] == pytest.approx(size, abs=0.1)
