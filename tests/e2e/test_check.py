"""Checks and repairs on the simulated cell: what changed is named, found anew and loaded."""

import pytest
from command_line import change
from ruamel.yaml import YAML


@pytest.mark.long
def test_a_calibration_is_checked_and_an_encoder_that_slipped_is_repaired(pkmcal, exported):
    refused = pkmcal("check", exported, "--repair", "--yes")
    assert refused.code == 2
    assert "not checked yet" in refused.error_line
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
    assert bad.document["next"] == f"pkmcal check {exported} --repair"
    assert pkmcal("status", exported, "--json").document["next"] == bad.document["next"]
    assert bad.document["says"] in pkmcal("status", exported).out
    repaired = pkmcal("check", exported, "--repair", "--yes", "--json")
    assert repaired.code == 0, repaired.err
    assert repaired.document["pedigree"]["changed"] == ["arm 2's encoder"]
    assert bad.document["says"] not in pkmcal("status", exported).out
    assert repaired.document["next"] == f"pkmcal export {exported} --overwrite"
    assert pkmcal("export", exported, "--overwrite").code == 0
    assert "pedigree" in (exported / "robot-compensated.yaml").read_text(encoding="utf-8")
    assert pkmcal("load", exported, "--yes").code == 0
    again = pkmcal("check", exported, "--yes", "--json")
    assert (again.code, again.document["decision"]) == (0, "pass"), again.err
    assert pkmcal("load", exported, "--rollback", "--yes").code == 0
    assert pkmcal("check-journal", exported).code == 0
    assert pkmcal("report", exported).code in {0, 1}
