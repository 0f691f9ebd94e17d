"""A robot's parameters in LinuxCNC: in a HAL file for its next start, and in its pins now."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from drivers.errors import DeviceRefused, DriverError
from drivers.linuxcnc.pins import HalPins


class ParameterFile(Protocol):
    """A file of parameters that is read when LinuxCNC starts. Errors are its own."""

    def read(self) -> Mapping[str, float]:
        """All parameters by flat name; refuses another robot's."""
        ...

    def write(self, geometry: Mapping[str, float]) -> None:
        """Replace the file whole, and keep the one before."""
        ...

    def take_back(self) -> None:
        """Put back the file that the last `write` replaced."""
        ...


@dataclass(frozen=True, slots=True)
class FileParameters:
    """For a controller that only takes joints: the file alone, for our own conversion of poses."""

    file: ParameterFile

    @property
    def needs_machine_off(self) -> bool:
        """Nothing in LinuxCNC changes."""
        return False

    def read(self) -> Mapping[str, float]:
        """What poses are converted with."""
        return self.file.read()

    def write(self, geometry: Mapping[str, float]) -> None:
        """Replace the file."""
        self.file.write(geometry)


@dataclass(frozen=True, slots=True)
class HalParameters:
    """For a controller that runs our kinematics: the file and the pins, always the same."""

    file: ParameterFile
    pins: HalPins
    pin_of: Mapping[str, str]
    """The pin of each parameter."""

    @property
    def needs_machine_off(self) -> bool:
        """With power, changed parameters make the joints jump."""
        return True

    def read(self) -> Mapping[str, float]:
        """What LinuxCNC works with now; raises `DeviceRefused` when its file says otherwise."""
        held = self._parameters(self.pins.read())
        filed = self.file.read()
        if different := [name for name in held if held[name] != filed.get(name)]:
            name = different[0]
            raise DeviceRefused(
                f"LinuxCNC works with {name} = {held[name]!r}, its HAL file says "
                f"{filed.get(name)!r} ({len(different)} of {len(held)} differ)",
                remedy="restart LinuxCNC to take the file, or load again to replace both",
                code="FILE",
            )
        return held

    def write(self, geometry: Mapping[str, float]) -> None:
        """Replace file and pins, read the pins back; what does not verify is taken back.

        Raises `DeviceRefused`, with the machine on before anything is written.
        """
        before = self.pins.write({})
        self.file.write(geometry)
        try:
            self._set(geometry)
        except DriverError as error:
            raise self._taken_back(before, error) from error

    def _set(self, geometry: Mapping[str, float]) -> None:
        settings = {self.pin_of[name]: value for name, value in geometry.items()}
        held = self._parameters(self.pins.write(settings))
        for name, value in geometry.items():
            if held.get(name) != value:
                raise DeviceRefused(
                    f"{name} is {held.get(name)!r} in LinuxCNC after {value!r} was set",
                    remedy="check what else writes the pins of its kinematics",
                    code="PINS",
                )

    def _taken_back(self, before: Mapping[str, float], error: DriverError) -> DeviceRefused:
        self.file.take_back()
        try:
            restored = self.pins.write(before) == before
        except DriverError:
            restored = False
        if restored:
            problem, remedy = "the old parameters are back", error.remedy
        else:
            problem = "its old HAL file is back, but its pins could not be set back"
            remedy = "restart LinuxCNC before anything moves: it then takes the old file"
        return DeviceRefused(f"{error.problem}; {problem}", remedy=remedy, code="NOT LOADED")

    def _parameters(self, held: Mapping[str, float]) -> dict[str, float]:
        return {name: held[pin] for name, pin in self.pin_of.items()}
