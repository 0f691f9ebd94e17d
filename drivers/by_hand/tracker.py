"""A tracker whose points a person types or pastes (docs/by-hand.md)."""

from typing_extensions import override

from drivers import values
from drivers.by_hand.asking import answered, identity, require_somebody
from drivers.declaration import Surroundings, TrackerDriver
from drivers.errors import NotAMeasurement, WireError
from drivers.plausible import require_point
from drivers.ports import Clock, LaserTracker, Prompt
from drivers.wire.typed_numbers import typed_numbers

AXES = 3
NONE = "-"
QUESTION = f"measure the reflector and type or paste its point: x y z, mm ({NONE} for none) "


class TrackerByHand(LaserTracker):
    """A tracker of which nothing is known but the points that somebody gives."""

    def __init__(self, prompt: Prompt | None, serial: str) -> None:
        self._prompt = prompt
        self._serial = serial
        self._last: values.Vector3 | None = None

    def connect(self) -> None:
        """Do nothing: there is no wire."""

    reconnect = connect

    @override
    def identity(self) -> values.Identity:
        return identity("tracker", self._serial)

    def prepare(self, reflector: str, measuring_time_s: float) -> None:  # noqa: ARG002
        """Raise `AddressInvalid` where nobody can be asked; the rest is its operator's."""
        require_somebody(self._prompt, "tracker")

    def measure(self) -> values.Measurement:
        """Have somebody measure; raises `NotAMeasurement` when he gives no point.

        The point before, to the last digit, is asked for again: what was copied then is pasted now.
        """
        prompt = require_somebody(self._prompt, "tracker")
        point_mm, raw = answered(prompt, QUESTION, self._read)
        return values.Measurement(point_mm, None, None, raw)

    def _read(self, text: str) -> tuple[values.Vector3, str]:
        if text.strip() == NONE:
            raise NotAMeasurement("no point was given", remedy="measure it again")
        point_mm = point_said(text)
        before, self._last = self._last, point_mm
        if point_mm == before:
            self._last = None  # whoever gives it once more means it
            raise WireError(
                "this is the point before, to the last digit",
                remedy="copy the new one; if it is right, give it once more",
            )
        return point_mm, text.strip()


def point_said(raw: str) -> values.Vector3:
    """Point, mm, of a line as records keep it; raises `DriverError`."""
    point_mm = values.vector(typed_numbers(raw, AXES))
    require_point("the typed line", point_mm)
    return point_mm


def _made(given: Surroundings, _instrument_clock: Clock | None) -> TrackerByHand:
    return TrackerByHand(given.prompt, str(given.own()))


DRIVER = TrackerDriver(_made, lambda raw: (point_said(raw), None))
