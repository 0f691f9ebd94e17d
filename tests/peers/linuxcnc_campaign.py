"""Campaigns whose controller is a real LinuxCNC, and whose hidden robot follows its joints."""

import json
import sys
from types import MappingProxyType

from command_line import change

from app.main import run_command


def tell(figures):
    """Show measured figures; `pytest -s` lets them through."""
    sys.stdout.write(f"{figures}\n")


def made_campaign(folder, linuxcnc, robot, settings, cell=MappingProxyType({})):
    """A campaign's folder for a robot by its name."""
    words = ["new", str(folder), "--robot", robot, "--scenario", "paper-simulation"]
    assert run_command(words) == 0
    address = {"controller.url": linuxcnc.url, "controller.speed_percent": 100.0}
    only_distances = dict.fromkeys(  # are measured
        ("acceptance.rotation_mm", "acceptance.straightness_mm", "acceptance.repeatability_mm")
    )
    change(folder / "campaign.yaml", settings | address | only_distances)
    change(folder / "cell.yaml", cell)
    linuxcnc.make_ready()
    return folder


class Campaign:
    """A campaign by its commands."""

    def __init__(self, folder, linuxcnc, capsys):
        self.folder, self._linuxcnc, self._capsys = folder, linuxcnc, capsys

    def __call__(self, command, *options, codes=(0,)):
        self._capsys.readouterr()
        assert run_command([command, str(self.folder), *options, "--json"]) in codes
        return json.loads(self._capsys.readouterr().out)

    def load(self, *options):
        """Load, and switch the machine on again, which only LinuxCNC's operator can do."""
        self("load", *options, "--yes")
        self._linuxcnc.make_ready()

    def validated(self, stage, codes=(0, 1)):
        """Errors of hold-out distances of the robot that LinuxCNC moves by poses."""
        distances = ("--only", "distances", "--yes")
        return self("validate", "--stage", stage, *distances, codes=codes)["distances_mm"]
