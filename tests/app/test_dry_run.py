"""`pkmcal run --dry`: what guards motion is checked at every command."""

import pytest
from command_line import ended, started

from campaigns.robots.robot import find_robot

NOWHERE = "tcp://127.0.0.1:1"
PACKAGE = """
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.kinematics.limbs import Crank
from campaigns.kinematics.platforms import HingedPlate


class Plate(HingedPlate):
    def _apart(self, turn):
        return 1.0 * super()._apart(turn)


OWN = ClosedChain("own", Crank(), Plate(shares=(-0.5, -0.5, 0.5, 0.5)))
"""


@pytest.fixture
def package(tmp_path, monkeypatch):
    """Another package's mechanism, for processes that are started."""
    info = tmp_path / "own_package-1.0.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: own-package\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[pkmcal.mechanisms]\nown = own_package:OWN\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    return tmp_path / "own_package.py"


def test_a_plan_is_checked_anew_when_the_code_of_the_mechanism_changed(tmp_path, package):
    def command(*words):
        return ended(started(*words))

    package.write_text(PACKAGE)
    shipped = find_robot("par4-prototype").document.text
    robot, folder = tmp_path / "own.yaml", tmp_path / "c"
    robot.write_text(shipped.replace("mechanism: par4", "mechanism: own"))
    devices = ("--controller", NOWHERE, "--tracker", NOWHERE)
    assert command("new", folder, "--robot", robot, *devices).code == 0
    assert command("plan", folder, "--shots", 12).code == 0
    assert command("run", folder, "--dry").code == 0
    package.write_text(PACKAGE.replace("1.0 *", "1.15 *"))
    refused = command("run", folder, "--dry")
    assert refused.code == 2
    assert "q0_deg is" in refused.error_line
