"""Checks on the simulated cell: what changed is named, and the set is updated."""

import pytest
from command_line import change
from ruamel.yaml import YAML


@pytest.mark.long
@pytest.mark.timeout(400)
def test_a_calibration_is_checked_and_updated_after_an_encoder_has_slipped(pkmcal, exported):
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
    assert "encoder 2" in bad.document["parts"]
    assert bad.document["next"].endswith(" --update")
    assert pkmcal("status", exported, "--json").document["next"] == bad.document["next"]
    assert bad.document["says"] in pkmcal("status", exported).out
    assert pkmcal("check-journal", exported).code == 0
    assert pkmcal("report", exported).code in {0, 1}
    updated = pkmcal("identify", exported, "--update", "--json")
    assert (updated.code, updated.document["verdict"]) == (0, "pass"), updated.err
    new = updated.document["parameters"][name]
    assert abs(new["delta"]) > 0.0
    assert updated.document["pedigree"]["shots"] == bad.document["shots"]
    assert pkmcal("export", exported, "--force").code == 0
    assert pkmcal("load", exported, "--yes").code == 0
    again = pkmcal("check", exported, "--yes", "--json")
    assert (again.code, again.document["decision"]) == (0, "pass"), again.err
