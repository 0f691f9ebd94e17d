"""Fewer parameters than were identified, by the commands: what is written, said and refused."""

import numpy as np
from command_line import change
from family_cases import BY_NAME

from campaigns.robots.robot import read_robot


def test_plain_parameters_of_a_set_without_tilts_are_the_set(pkmcal, tmp_path):
    member, folder = BY_NAME["linear-delta"], tmp_path / "linear-delta"
    assert pkmcal("new", folder, "--robot", member.name).code == 0
    change(folder / "campaign.yaml", {"space.radius_mm": 220.0})  # where the shots lie
    assert pkmcal("import", folder, member.shots_file("noise")).code == 0
    assert pkmcal("identify", folder, "--hold-out", "20%", "--model", "paper").code == 0
    assert pkmcal("export", folder).code == 0
    ended = pkmcal("export", folder, "--format", "plain", "--json")
    assert ended.document["left_mm"]["these values"]["max"] < 1e-9
    plain = read_robot(folder / "robot-plain.yaml").robot
    full = read_robot(folder / "robot-compensated.yaml").robot
    poses = member.poses(50)
    joints = full.kinematics.inverse(poses).values_or_raise()
    np.testing.assert_allclose(plain.kinematics.inverse(poses).values_or_raise(), joints, atol=1e-9)
    assert plain.provenance["projection"]["of"] == full.digest()
    shown = pkmcal("export", folder, "--format", "plain", "--force")
    assert "Remaining error of position (mm)" in shown.out
