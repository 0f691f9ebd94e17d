"""Checks on the simulated cell: what changed is named."""

import pytest
from command_line import change
from ruamel.yaml import YAML


@pytest.mark.long
def test_a_calibration_is_checked_and_an_encoder_that_slipped_is_named(pkmcal, exported):
    assert pkmcal("load", exported, "--yes").code == 0
    good = pkmcal("check", exported, "--yes", "--json")
    assert (good.code, good.document["decision"]) == (0, "pass"), good.err
    cell = YAML().load(exported / "cell.yaml")
    name = "arm2.joint_offset_deg"
    old = cell["robot"]["errors"].get(name, 0.0)
    change(exported / "cell.yaml", {"robot.errors": {**cell["robot"]["errors"], name: old + 0.05}})
    (exported / "cell-memory.json").unlink()  # of a cell whose plate stood elsewhere
    bad = pkmcal("check", exported, "--yes", "--json")
    assert (bad.code, bad.document["decision"]) == (1, "fail"), bad.err
    part = bad.document["changed"][0]
    assert part["name"] == name
    assert part["size"] == pytest.approx(0.05, abs=2.0 * part["expanded_uncertainty"])
    assert bad.document["next"] == f"pkmcal run {exported} --anew"
    assert pkmcal("status", exported, "--json").document["next"] == bad.document["next"]
    assert bad.document["says"] in pkmcal("status", exported).out
    assert pkmcal("check-journal", exported).code == 0
    assert pkmcal("report", exported).code in {0, 1}
