"""Ports of the devices; a new controller or tracker is driven by providing one.

They are all that campaigns know of a device. Units are mm, rad and s; a driver converts what its
wire has. Methods wait for the device's answer within a deadline of the driver's own and raise an
error of `drivers/errors.py`, but a `move_*` returns when the motion has begun: `state` then shows
its end, so that a stop can come between. `LinkDown`, `WireError` and `Cancelled` leave a wire
closed: every call but `connect`, `reconnect`, `stop` and `close` then raises `LinkDown`.
"""

import time
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Protocol

from drivers import values

Prompt = Callable[[str], str]
"""Asks the operator and returns the line that is typed; raises `Cancelled` at the wish to stop."""
BACK = "u"
"""Answer of an operator who wants the last shot, or observation, again."""


class Clock(Protocol):
    """Time as the cell feels it: the wall clock, or a simulated cell's faster one."""

    def now_s(self) -> float:
        """Return the seconds since an arbitrary start; they never go back."""

    def sleep_s(self, seconds: float) -> None:
        """Return after that much of this clock's time."""


class RobotController(Protocol):
    """A robot's controller. Every call has a deadline; `state` watches what `move_*` started."""

    shows_motion: bool = True
    """Whether `state` is that of the encoders while the robot moves. Not where a
    person moves it and types where it stands."""

    @property
    def knows_its_time(self) -> bool:
        """Whether its robot's seconds are the clock's: a simulated one's may be shorter."""
        return True

    def connect(self) -> None:
        """Open the wire and see who answers; raises `LinkDown`, `WireError` or `WrongDevice`.

        From the second time on it must be the same controller that answers.
        """

    def identity(self) -> values.Identity:
        """Return the identity of the device that answers, with serial number and firmware."""

    def state(self) -> values.RobotState:
        """Read the encoders, and whether anything is wrong."""

    def prepare(self) -> None:
        """Bring the robot into the state that moving needs; repeatable after any fault.

        May switch on and home, that is move. Raises `EmergencyStop` or `MotionFault` if it cannot.
        """

    def move_joints(self, joints: Sequence[float], speed_fraction: float) -> None:
        """Start a joint move.

        Raises `LimitViolation`, `MotionFault` or `EmergencyStop` when it is refused.
        """

    def move_pose(self, pose: values.Pose, speed_fraction: float) -> None:
        """Start a move to a pose by the controller's own inverse kinematics."""

    def stop(self) -> None:
        """Stop at once. Returns only when the controller has confirmed it."""

    def read_geometry(self) -> Mapping[str, float]:
        """Return the active parameters by flat name (`arm0.x_mm`, …, `plate_mm`), mm and deg.

        Those of imperfect parts (axis tilts, skews) are left out where they are 0.
        """

    def lacks(self, names: Collection[str]) -> tuple[str, ...]:
        """Return which of the named parameters of imperfect parts its kinematics lacks."""

    def write_geometry(self, geometry: Mapping[str, float]) -> None:
        """Replace all parameters at once, or none; the robot stands still meanwhile."""

    def reconnect(self) -> None:
        """Open again after a fault of the wire; raises `WrongDevice` if another device answers."""

    def close(self) -> None:
        """Leave the robot standing and the wire free."""


class LaserTracker(Protocol):
    """A laser tracker. Points are Cartesian, right-handed, in the tracker's own frame.

    What a driver leaves out is as of an instrument that its operator looks after and aims: ready,
    without a wire, and nothing is known of its air, its reflectors, its direction.
    """

    def connect(self) -> None:
        """Open the wire and see who answers; raises `LinkDown`, `WireError` or `WrongDevice`.

        From the second time on it must be the same tracker that answers.
        """

    def identity(self) -> values.Identity:
        """Return the identity of the device that answers, with serial number and firmware."""

    def state(self) -> values.TrackerState:
        """Return the traffic light, warm-up, beam and reflector in use."""
        return values.TrackerState(
            readiness=values.Readiness.READY,
            initialised=True,
            laser_warm=True,
            beam_locked=True,
            reflector="",
        )

    def weather(self) -> values.Weather | None:
        """Return air temperature, pressure and humidity as the instrument uses them, if known."""
        return None

    def reflectors(self) -> tuple[values.Reflector, ...]:
        """Return the reflectors that the instrument has definitions for."""
        return ()

    def prepare(self, reflector: str, measuring_time_s: float) -> None:
        """Bring the instrument into the state that measuring needs; repeatable after any fault.

        Raises `DeviceNotReady` when it is not initialised, not warm or lacks the named reflector.
        """

    def measure(self) -> values.Measurement:
        """Measure the reflector, which stands still; raises `BeamBroken` when it is lost.

        `NoReflector`, which is one of these, when there was none to begin with.
        """

    def direction(self) -> values.Vector3 | None:
        """Return the beam's direction, a unit vector in the tracker's frame; None: unknown."""
        return None

    def go_to(self, point_in_tracker_mm: values.Vector3) -> None:  # noqa: ARG002 - as said above
        """Point there and lock onto the reflector found near; `BeamBroken` when there is none."""
        return

    def find_reflector(self, distance_mm: float) -> None:  # noqa: ARG002 - as said above
        """Search around the present direction at about that distance."""
        return

    def reconnect(self) -> None:
        """Open again after a fault of the wire, and prepare the instrument as it was."""

    def close(self) -> None:
        """Leave the instrument as it is and the wire free."""
        return


class SystemClock:
    """Real time."""

    def now_s(self) -> float:
        """Return the seconds of the monotonic clock."""
        return time.monotonic()

    def sleep_s(self, seconds: float) -> None:
        """Sleep for real."""
        time.sleep(seconds)
