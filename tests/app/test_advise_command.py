"""pkmcal advise, on a campaign in which everything was done."""

import json

from paper_campaign import ERRORS


def test_it_says_what_to_mend_and_what_to_leave(pkmcal, whole):
    code, out, err = pkmcal("advise", whole.folder, "--json")
    advice = json.loads(out)["advice"]
    assert code == 0
    (only,) = advice["instructions"]
    assert only["says"].startswith(f"arm 2's home is {abs(only['size']):.3f}°")
    assert abs(only["size"] - ERRORS["arm2.joint_offset_deg"]) < only["expanded"]
    assert only["says"] in " ".join(err.split())
    assert max(map(len, err.splitlines())) <= 80
    assert any("arm0.arm +1.00 mm" in parts for parts in advice["left"].values())


def test_without_an_identification_it_says_what_to_run(pkmcal, tmp_path):
    pkmcal("new", tmp_path / "cell", "--robot", "delta")
    code, _, err = pkmcal("advise", tmp_path / "cell")
    assert code == 2
    assert "nothing" in err
