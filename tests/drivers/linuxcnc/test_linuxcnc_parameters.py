"""A robot's parameters in LinuxCNC: file and pins together, or neither."""

import pytest

from drivers.errors import DeviceRefused, LinkDown
from drivers.linuxcnc.hal_parameters import FileParameters, HalParameters

PIN_OF = {"arm0.x_mm": "pkmkins.arm0.x_mm", "plate_mm": "pkmkins.plate_mm"}
OLD = {"arm0.x_mm": -172.5, "plate_mm": 100.0}
NEW = {"arm0.x_mm": -172.4, "plate_mm": 100.1}


class File:
    """A parameter file in memory, with what it replaced."""

    def __init__(self):
        self.geometry, self.before = dict(OLD), None

    def read(self):
        return self.geometry

    def write(self, geometry):
        self.before, self.geometry = self.geometry, dict(geometry)

    def take_back(self):
        self.geometry = self.before


class Pins:
    """Pins in memory. `sticks` is one that keeps its value; `breaks_at` the write that fails."""

    def __init__(self):
        self.values = {PIN_OF[name]: value for name, value in OLD.items()}
        self.powered, self.sticks, self.breaks_at, self.writes = False, None, None, 0

    def read(self):
        return dict(self.values)

    def write(self, values):
        if self.powered:
            raise DeviceRefused("LinuxCNC's machine is on", remedy="-")
        self.writes += bool(values)
        if values and self.breaks_at is not None and self.writes >= self.breaks_at:
            raise LinkDown("LinuxCNC's HAL cannot be reached", remedy="-")
        self.values |= {pin: value for pin, value in values.items() if pin != self.sticks}
        return dict(self.values)


@pytest.fixture
def store():
    return HalParameters(File(), Pins(), PIN_OF)


def held(store):
    """What pins and file hold."""
    return {name: store.pins.values[pin] for name, pin in PIN_OF.items()}, store.file.geometry


def test_what_works_now_is_read_from_the_pins(store):
    assert store.read() == OLD


def test_file_that_the_running_linuxcnc_has_not_taken_is_told(store):
    store.file.geometry = dict(NEW)
    with pytest.raises(DeviceRefused, match=r"-172\.5.*-172\.4.*2 of 2 differ") as error:
        store.read()
    assert "restart LinuxCNC" in error.value.remedy


def test_file_and_pins_are_written_and_verified(store):
    store.write(NEW)
    assert held(store) == (NEW, NEW)


def test_nothing_is_written_with_the_machine_on(store):
    store.pins.powered = True
    with pytest.raises(DeviceRefused, match="machine is on"):
        store.write(NEW)
    assert held(store) == (OLD, OLD)


def test_pin_that_does_not_take_its_value_has_everything_taken_back(store):
    store.pins.sticks = "pkmkins.plate_mm"
    with pytest.raises(DeviceRefused, match=r"plate_mm is 100\.0.*old parameters are back"):
        store.write(NEW)
    assert held(store) == (OLD, OLD)


def test_pins_that_cannot_be_set_back_are_told_loudly(store):
    store.pins.breaks_at = 1
    with pytest.raises(DeviceRefused, match="old HAL file is back, but its pins") as error:
        store.write(NEW)
    assert "restart LinuxCNC before anything moves" in error.value.remedy
    assert store.file.geometry == OLD


def test_only_parameters_inside_linuxcnc_need_the_machine_off(store):
    assert store.needs_machine_off
    assert not FileParameters(File()).needs_machine_off


def test_parameters_of_our_own_conversion_are_the_file_alone():
    store = FileParameters(File())
    store.write(NEW)
    assert store.read() == NEW
