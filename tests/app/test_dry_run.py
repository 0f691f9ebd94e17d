"""`pkmcal run --dry`: what guards motion is checked at every command."""

import pytest
from command_line import ended, started

from campaigns.robots.robot import find_robot

NOWHERE = "tcp://127.0.0.1:1"
PACKAGE = """
from campaigns.mechanisms.arms import RotaryArms
from campaigns.mechanisms.closed_chain import ClosedChain
from campaigns.mechanisms.platforms import HingedPlate


class Plate(HingedPlate):
    def apart(self, turn):
        return super().apart(1.0 * turn)

    def apart_by_turn(self, turn):
        return 1.0 * super().apart_by_turn(1.0 * turn)


OWN = ClosedChain("own", RotaryArms, Plate(shares=(-0.5, 0.5)), held_fields=("azimuth_deg",))
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
