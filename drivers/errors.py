"""Errors of a device, named by what the operator does next."""

from collections.abc import Mapping

from drivers.texts import printable, shortened

PROBLEM_CHARACTERS, REMEDY_CHARACTERS = 600, 300
PRESS_THE_EMERGENCY_STOP = "PRESS THE EMERGENCY STOP"


class ExplainedError(Exception):
    """An error that an operator can act on: what is wrong, and what to do next, in one line.

    As a text it is cleaned and of bounded length, whatever a device or file has put into it.
    """

    page = ""
    """Page and heading that say more, as `docs/reference/files.md#plancsv`, or empty."""
    details: Mapping[str, object] = {}
    """Values that `--json` prints beside the error, by their keys."""

    def __init__(self, problem: str, *, remedy: str, options: str = "") -> None:
        """`options` are words that let the same command go ahead; "" if none does."""
        super().__init__(problem, remedy)
        self.problem = problem
        self.remedy = remedy
        self.options = options

    def __str__(self) -> str:
        problem = shortened(self.problem, PROBLEM_CHARACTERS)
        return printable(f"{problem} → {shortened(self.remedy, REMEDY_CHARACTERS)}")


class DriverError(ExplainedError):
    """Root of everything that a driver raises."""


class WireError(DriverError):
    """Bytes that are not of the protocol; the only error that garbage from a wire may raise."""

    def __init__(
        self, problem: str, *, remedy: str = "check the cable and the device's protocol"
    ) -> None:
        super().__init__(problem, remedy=remedy)


class AddressInvalid(DriverError):
    """A device's URL cannot be read or opened as it is written."""


class LinkDown(DriverError):
    """Link without connection or answer in time. It is closed: a late answer is never read."""


class Cancelled(DriverError):
    """The operator asked to stop while a device was being waited for. The link is closed."""


class WrongDevice(DriverError):
    """Device that answers, but is not the one that was expected."""


class DeviceRefused(DriverError):
    """The device understood and said no. `code` is the device's own word for it."""

    def __init__(self, problem: str, *, remedy: str, code: str = "") -> None:
        super().__init__(problem, remedy=remedy)
        self.code = code


class ImplausibleAnswer(DeviceRefused):
    """The device answers what cannot be: nothing can be computed from it, and nothing goes on."""


class DeviceNotReady(DeviceRefused):
    """The device cannot work yet: not initialised, not warm, no such reflector, busy."""


class BeamBroken(DeviceRefused):
    """The tracker has lost its reflector."""


class NoReflector(BeamBroken):
    """The tracker had no reflector when it was asked to measure: this pose may not be seen."""


class NotAMeasurement(BeamBroken):
    """A tracker's result that cannot be of the measurement that was asked for.

    A broken beam's kind of failure: the shot gave no data, and is taken again.
    """


class LimitViolation(DeviceRefused):
    """The controller refuses a target outside its limits or its reach."""


class MotionFault(DeviceRefused):
    """The controller stopped by itself: drive fault, following error, disabled."""


class EmergencyStop(MotionFault):
    """The emergency stop is pressed."""


class RobotStateUnknown(DriverError):
    """A stop could not be confirmed. The loudest error there is: what to do stands first."""

    def __str__(self) -> str:
        return f"{PRESS_THE_EMERGENCY_STOP}: {super().__str__()}"
