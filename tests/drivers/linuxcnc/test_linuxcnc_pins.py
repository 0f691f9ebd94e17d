"""HAL pins from outside: full doubles both ways, never with the machine on."""

import json
import sys

import pytest

from drivers.errors import DeviceRefused, LinkDown, WireError
from drivers.linuxcnc.hal_parameters import HalPins

NAMES = ("pkmkins.arm0.x_mm", "pkmkins.plate_mm")
ODD = 0.1 + 0.2  # needs 17 digits

HAL = """
import json, pathlib

FILE = pathlib.Path(__file__).with_name("pins.json")

class component:
    def __init__(self, name):
        if not FILE.exists():
            raise ImportError("no HAL")
    def ready(self): pass
    def exit(self): pass

def get_value(name):
    pins = json.loads(FILE.read_text())
    if name not in pins:
        raise RuntimeError("Can't set value: pin / param %s not found" % name)
    return pins[name]

def set_p(name, text):
    pins = json.loads(FILE.read_text())
    if name not in pins:
        raise RuntimeError("pin not found")
    pins[name] = float(text)
    FILE.write_text(json.dumps(pins))
"""


class Hal:
    """A LinuxCNC's HAL in a folder, and the access to it."""

    def __init__(self, folder):
        (folder / "hal.py").write_text(HAL)
        self.file = folder / "pins.json"
        self.pins = {"motion.motion-enabled": False, NAMES[0]: -172.5, NAMES[1]: 100.0}
        self.save()
        prefix = ("env", f"PYTHONPATH={folder}")
        self.reached_by = {"prefix": prefix, "python": sys.executable}

    def save(self):
        self.file.write_text(json.dumps(self.pins))

    def outside(self, names=NAMES):
        return HalPins(names, **self.reached_by)


@pytest.fixture
def hal(tmp_path):
    return Hal(tmp_path)


def test_pins_are_read_and_set_as_full_doubles(hal):
    assert hal.outside().write({NAMES[1]: ODD}) == {NAMES[0]: -172.5, NAMES[1]: ODD}
    assert hal.outside().read()[NAMES[1]] == ODD
    hal.pins[NAMES[0]] = ODD
    hal.save()
    assert hal.outside().read() == {NAMES[0]: ODD, NAMES[1]: 100.0}


def test_module_that_lies_where_pins_are_read_from_is_not_imported(hal, tmp_path, monkeypatch):
    (elsewhere := tmp_path / "campaign").mkdir()
    (elsewhere / "json.py").write_text("open('ran', 'w')\n")
    monkeypatch.chdir(elsewhere)
    assert hal.outside().read()
    assert not (elsewhere / "ran").exists()


def test_nothing_is_set_while_the_machine_is_on(hal):
    hal.pins["motion.motion-enabled"] = True
    hal.save()
    with pytest.raises(DeviceRefused, match="machine is on"):
        hal.outside().write({NAMES[1]: ODD})
    assert hal.outside().read()[NAMES[1]] == 100.0


def test_other_pins_or_none_are_told(hal):
    with pytest.raises(DeviceRefused, match=r"without the pins.*rotarydeltakins.x"):
        hal.outside(("rotarydeltakins.x",)).read()
    hal.pins = {}
    hal.save()
    with pytest.raises(LinkDown, match="LinuxCNC does not run"):
        hal.outside().read()


@pytest.mark.parametrize(
    ("access", "reason"),
    [
        ({"python": "/nonexistent/python3"}, "No such file"),
        ({"python": sys.executable}, "No module named 'hal'"),
        ({"prefix": ("echo", "Permission denied (publickey)")}, "no answer"),
        ({"prefix": ("sh", "-c", "echo refused >&2; exit 255")}, "refused"),
        ({"prefix": ("sh", "-c", "exec sleep 5"), "within_s": 0.01}, "timed out"),
    ],
)
def test_access_that_leads_nowhere_says_why(access, reason):
    with pytest.raises(LinkDown, match=reason):
        HalPins(NAMES, **access).read()


@pytest.mark.parametrize(
    "answer",
    [
        '{"pins": {}}',
        '{"pins": {"pkmkins.arm0.x_mm": "nan", "pkmkins.plate_mm": "0x1p+0"}}',
        '{"pins": {"pkmkins.arm0.x_mm": 1.0, "pkmkins.plate_mm": "0x1p+0"}}',
        '{"pins": {"pkmkins.arm0.x_mm": "0x1p+99999", "pkmkins.plate_mm": "0x1p+0"}}',
        '{"pins": 3}',
        "{}",
    ],
)
def test_answer_that_is_none_is_refused(answer):
    with pytest.raises(WireError):
        HalPins(NAMES, prefix=("sh", "-c", f"echo '{answer}'")).read()


@pytest.mark.parametrize("said", ["printf '\\377\\376\\n'", "printf '[%.0s' $(seq 20000)"])
def test_answer_that_is_no_text_or_nests_without_an_end_leads_nowhere(said):
    with pytest.raises(LinkDown, match="no answer"):
        HalPins(NAMES, prefix=("sh", "-c", said)).read()
