"""A robot's parameters in LinuxCNC: file and pins together, or neither."""

import pytest

from drivers.errors import DeviceRefused, LinkDown
from drivers.linuxcnc.hal_parameters import HalParameters

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
        self.optional = frozenset()

    @property
    def required_names(self):
        return frozenset(self.values) - self.optional

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


def test_file_and_pins_are_written_and_read_back(store):
    assert store.read() == OLD
    store.write(NEW)
    assert held(store) == (NEW, NEW)


def test_file_that_the_running_linuxcnc_has_not_taken_is_told(store):
    store.file.geometry = dict(NEW)
    with pytest.raises(DeviceRefused, match=r"-172\.5.*-172\.4.*2 of 2 differ") as error:
        store.read()
    assert "restart LinuxCNC" in error.value.remedy


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


TILT, REFLECTOR = "arm0.axis_tilt_deg", "pkmkins.reflector_x_mm"
TILTED = NEW | {TILT: 0.02}


@pytest.fixture
def tilting():
    """A store whose kinematics has an extension, and a plate that is drawn."""
    pins = Pins()
    pins.values |= {f"pkmkins.{TILT}": 0.0, REFLECTOR: 0.0}
    pin_of = PIN_OF | {TILT: f"pkmkins.{TILT}"}
    return HalParameters(File(), pins, pin_of, frozenset({TILT}), {REFLECTOR: 20.0})


def test_extension_is_written_with_the_plates_drawing_and_set_back_to_zero(tilting):
    assert tilting.read() == OLD
    tilting.write(TILTED)
    assert tilting.pins.values[f"pkmkins.{TILT}"] == 0.02
    assert tilting.pins.values[REFLECTOR] == 20.0
    assert tilting.read() == TILTED == tilting.file.geometry
    tilting.write(TILTED)
    tilting.write(OLD)
    assert tilting.pins.values[f"pkmkins.{TILT}"] == 0.0
    assert tilting.read() == OLD


def test_extension_that_only_the_file_or_only_linuxcnc_has_is_told(tilting):
    tilting.file.geometry = OLD | {TILT: 0.02}
    with pytest.raises(DeviceRefused, match=r"axis_tilt_deg = 0\.0.*says 0\.02"):
        tilting.read()
    tilting.file.geometry = dict(OLD)
    tilting.pins.values[f"pkmkins.{TILT}"] = 0.02
    with pytest.raises(DeviceRefused, match=r"axis_tilt_deg = 0\.02"):
        tilting.read()


def test_plate_that_is_drawn_otherwise_counts_only_where_it_tilts(tilting):
    tilting.pins.values[REFLECTOR] = 21.0
    assert tilting.read() == OLD
    tilting.write(TILTED)
    tilting.pins.values[REFLECTOR] = 21.0
    with pytest.raises(DeviceRefused, match=r"reflector_x_mm = 21\.0, the robot file's plate"):
        tilting.read()


def test_pin_of_the_drawing_that_does_not_take_its_value_has_everything_taken_back(tilting):
    tilting.pins.sticks = REFLECTOR
    with pytest.raises(DeviceRefused, match=r"reflector_x_mm = 0\.0.*old parameters are back"):
        tilting.write(TILTED)
    assert tilting.read() == OLD
