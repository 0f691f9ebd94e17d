"""Fewer parameters than were identified, by the commands: what is written, said and refused."""

import json

import numpy as np
import pytest
from command_line import change
from family_cases import BY_NAME

from app.main import run_command
from campaigns.robots.robot import read_robot

pytestmark = pytest.mark.slow


@pytest.fixture(
    scope="module",
    params=[pytest.param(name, marks=pytest.mark.long) for name in ("delta", "h4")]
    + ["linear-delta"],
)
def campaign(request, tmp_path_factory):
    """A member's noisy shots, identified with a share of the pairs unseen; its folder and name."""
    member = BY_NAME[request.param]
    folder = tmp_path_factory.mktemp("members") / member.name
    assert run_command(["new", str(folder), "--robot", member.name]) == 0
    if member.name == "linear-delta":  # whose shots all lie near its axis
        change(folder / "campaign.yaml", {"space.radius_mm": 220.0})
    assert run_command(["import", str(folder), str(member.shots_file("noise"))]) == 0
    assert run_command(["identify", str(folder), "--hold-out", "20%", "--model", "paper"]) == 0
    return member, folder


def test_plain_parameters_of_a_set_without_tilts_are_the_set(campaign, pkmcal):
    member, folder = campaign
    assert pkmcal("export", folder, "--force").code == 0
    ended = pkmcal("export", folder, "--format", "plain", "--force", "--json")
    assert ended.document["left_mm"]["these values"]["max"] < 1e-9
    plain = read_robot(folder / "robot-plain.yaml").robot
    full = read_robot(folder / "robot-compensated.yaml").robot
    poses = member.poses(50)
    joints = full.kinematics.inverse(poses).values_or_raise()
    np.testing.assert_allclose(plain.kinematics.inverse(poses).values_or_raise(), joints, atol=1e-9)
    assert plain.provenance["projection"]["of"] == full.digest()
    shown = pkmcal("export", folder, "--format", "plain", "--force")
    assert "Remaining error of position (mm)" in shown.out


def test_targets_of_every_member_are_corrected(campaign, pkmcal, tmp_path):
    member, folder = campaign
    assert pkmcal("export", folder, "--force").code == 0
    x, y, z = member.shipped.workspace_centre[:3]
    turn, column = (",0", ",theta_deg") if len(member.mechanism.task) > 3 else ("", "")
    path = tmp_path / "targets.csv"
    path.write_text(f"x_mm,y_mm,z_mm{column}\n{x},{y},{z}{turn}\n", encoding="utf-8")
    ended = pkmcal("correct", folder, "--poses", path, "--json")
    document = json.loads(ended.out)
    assert ended.code == 0
    assert 0.01 < document["correction_mm"]["max"] < 20.0
    assert 0.0 < document["position_std_mm"] < 0.1
