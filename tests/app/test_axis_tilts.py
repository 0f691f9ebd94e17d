"""Parameters that no controller knows are refused before anything is connected."""

from app.main import run_command
from campaigns.campaign import open_campaign
from campaigns.robots.robot import Compensation, compensated, write_new_robot

NOBODY = "tcp://127.0.0.1:1"


def test_a_tilted_robot_is_not_loaded_and_nobody_is_connected(capsys, tmp_path):
    folder = tmp_path / "cell"
    words = ["new", str(folder), "--controller", NOBODY, "--tracker", NOBODY]
    assert run_command(words) == 0
    nominal = open_campaign(folder).nominal
    flat = nominal.robot.geometry_flat() | {"arm1.axis_tilt_deg": 0.02}
    tilted = compensated(nominal, Compensation("tilted", flat, {}, {}))
    write_new_robot(folder / "robot-compensated.yaml", tilted)
    capsys.readouterr()
    code = run_command(["load", str(folder), "--yes", "--json"])
    said = capsys.readouterr()
    assert code == 2
    assert "arm1.axis_tilt_deg is 0.02" in said.err
    assert "identify again with --fix 'arm*.axis_tilt_deg', and export again" in said.err
    assert said.out == ""
    assert not (folder / "campaign.db").exists()
