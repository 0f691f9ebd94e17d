"""Campaigns whose controller is a real LinuxCNC, and whose hidden robot follows its joints."""

import sys
from functools import partial
from types import MappingProxyType

from command_line import change
from linuxcnc_bench import PATIENT

from app import driver_settings
from app.consent import consent_note
from app.main import run_command
from drivers.linuxcnc.settings import LinuxcncSettings


def tell(figures):
    """Show measured figures; `pytest -s` lets them through."""
    sys.stdout.write(f"{figures}\n")


def patient_driver(monkeypatch, tmp_path):
    """Have the product's driver wait for a busy machine; consents are kept in the test's folder."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    patient = partial(LinuxcncSettings, deadlines=PATIENT)
    monkeypatch.setattr(driver_settings, "LinuxcncSettings", patient)


def made_campaign(folder, linuxcnc, robot, settings, cell=MappingProxyType({})):
    """A campaign's folder for a robot by its name; its commands are consented to."""
    words = ["new", str(folder), "--robot", robot, "--scenario", "paper-simulation"]
    assert run_command(words) == 0
    section = {
        "coordinates": "world",
        "hal_file": str(linuxcnc.config / "calib.hal"),
        "beside": str(linuxcnc.beside),
    }
    address = {
        "controller.driver": "linuxcnc",
        "controller.url": linuxcnc.url,
        "controller.speed_percent": 100.0,
        "controller.linuxcnc": section,
    }
    change(folder / "campaign.yaml", settings | address)
    change(folder / "cell.yaml", {"controller.joints_from": f"hal:{linuxcnc.beside}"} | cell)
    for name in ("campaign.yaml", "cell.yaml"):
        note = consent_note(folder / name, str(linuxcnc.beside))
        note.parent.mkdir(parents=True, exist_ok=True)
        note.touch()
    return folder
