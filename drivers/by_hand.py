"""Devices worked by a person, who is shown what to do and types what the displays show.

How they are used: docs/how-to/by-hand.md. There is no wire, so that nothing can be late or lost,
but a person errs in other ways: a display is copied before the robot has arrived, a point of the
clipboard is pasted twice, a digit is missing. Each answer is therefore checked at once (count of
numbers, bounds, distance from the target, equality with the point before), and asked for again with
the reason.
"""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeVar

from typing_extensions import override

from drivers import values
from drivers.declaration import RobotSurroundings, Surroundings
from drivers.errors import (
    AddressInvalid,
    DeviceRefused,
    ImplausibleAnswer,
    NotAMeasurement,
    WireError,
)
from drivers.plausible import require_joints, require_point
from drivers.ports import BACK, LaserTracker, Prompt, RobotController
from drivers.wire.robotline import RobotLayout
from drivers.wire.typed_numbers import typed_numbers

NO_POINT = "-"
AGAIN = f"{BACK}: the last shot again"
QUESTION = (
    f"measure the reflector and type or paste its point: x y z, mm ({NO_POINT}: none, {AGAIN}) "
)

Read = TypeVar("Read")


@dataclass(frozen=True, slots=True, kw_only=True)
class HandSettings:
    """Facts about a robot that a person moves."""

    serial: str
    in_place: tuple[float, ...]
    """Largest accepted distance of each joint from its target, rad or mm."""
    read: Callable[[], Mapping[str, float]]
    """Parameters that were typed into the controller last, the nominal ones before."""
    write: Callable[[Mapping[str, float]], None]
    """Keep the parameters that were typed into the controller."""
    lacks: Callable[[Collection[str]], tuple[str, ...]]
    """Of the named parameters, those that the controller does not have."""
    joints_of: Callable[[Mapping[str, float], values.Pose], tuple[float, ...]]
    """Joints of a pose by a parameter set; raises `LimitViolation`."""


def _require_prompt(prompt: Prompt | None, device: str) -> Prompt:
    """Return whom to ask; raises `AddressInvalid` where there is no one."""
    if prompt is None:
        raise AddressInvalid(
            f"the {device} is worked by hand, and there is no terminal to ask at",
            remedy=f"run it on a terminal, or set another {device}.driver in campaign.yaml",
        )
    return prompt


def _answer(prompt: Prompt, question: str, read: Callable[[str], Read]) -> Read:
    """Ask a person, and again with the reason while `read` refuses the answer."""
    # The loop ends by a good answer, or by the `Cancelled` that a prompt raises.
    text = question
    while True:
        try:
            return read(prompt(text))
        except WireError as error:
            text = f"{error}\n{question}"
        except ImplausibleAnswer as error:
            text = f"{error.problem}\n{question}"


class RobotByHand(RobotController):
    """A robot whose joints are those that a person reads off its display and types."""

    shows_motion = False

    def __init__(self, surroundings: RobotSurroundings) -> None:
        self._settings = surroundings.settings_as(HandSettings)
        self._layout = surroundings.layout
        self._prompt = surroundings.prompt
        # The joints typed last, rad or mm; None: none since connecting.
        self._joints: tuple[float, ...] | None = None
        self._raw = ""

    @override
    def connect(self) -> None:
        self._joints = None

    reconnect = connect

    @override
    def identity(self) -> values.Identity:
        return values.Identity("operator", "robot", self._settings.serial, "-", "by hand")

    def state(self) -> values.RobotState:
        """Return the joints typed last: asked for if none were, empty if no one can be asked."""
        if self._joints is None and self._prompt is not None:
            axes = self._layout.joints
            question = "where is the robot? type the joints that its display shows"
            self._joints, self._raw = _answer(
                self._prompt,
                f"{question}: {_names(axes)}, {_unit(axes)} ",
                lambda text: (self._read(text), text.strip()),
            )
        joints = self._joints or ()
        return values.RobotState(
            joints, moving=False, fault="", emergency_stop=False, raw=self._raw
        )

    @override
    def prepare(self) -> None:
        _require_prompt(self._prompt, "controller")

    def move_joints(self, joints: Sequence[float], speed_fraction: float) -> None:  # noqa: ARG002
        """Have a person move the robot; ask again while the display shows another place."""
        self._move("move the robot", tuple(joints))

    def move_pose(self, pose: values.Pose, speed_fraction: float) -> None:  # noqa: ARG002
        """Have a person move the robot to a pose by the controller's own kinematics.

        The joints to expect are those of the parameters that it holds.
        """
        axes = self._layout.coordinates
        shown = zip(axes, values.outer_units(axes, pose.coordinates), strict=True)
        place = " ".join(
            f"{axis.name} {value:.3f}{' °' if axis.is_angle else ' mm'}"
            for axis, value in shown
            if not axis.is_fixed
        )
        target = self._settings.joints_of(self._settings.read(), pose)
        self._move(f"move the robot to the pose {place}, by its controller's kinematics", target)

    def stop(self) -> None:
        """Do nothing: the operator moves the robot and stands beside it."""

    @override
    def read_geometry(self) -> Mapping[str, float]:
        return self._settings.read()

    @override
    def lacks(self, names: Collection[str]) -> tuple[str, ...]:
        return self._settings.lacks(names)

    @override
    def write_geometry(self, geometry: Mapping[str, float]) -> None:
        prompt = _require_prompt(self._prompt, "controller")
        table = "\n".join(f"  {name:<32}{value:.6f}" for name, value in geometry.items())
        question = f"type these parameters into the robot's controller:\n{table}"
        if prompt(f"{question}\nhas it taken all of them? [y/N] ").lower() not in {"y", "yes"}:
            raise DeviceRefused(
                "nobody has typed the parameters into the controller",
                remedy="load again when somebody can; put back by hand what was changed meanwhile",
            )
        self._settings.write(geometry)

    def close(self) -> None:
        """Do nothing: there is no wire."""

    def _move(self, command: str, target: tuple[float, ...]) -> None:
        prompt = _require_prompt(self._prompt, "controller")
        axes = self._layout.joints
        # Four decimals: 0.0001° is 2 µm at a metre.
        shown = " ".join(f"{value:.4f}" for value in values.outer_units(axes, target))
        question = f"{command}, {_names(axes)} = {shown} {_unit(axes)}"

        def read(text: str) -> tuple[tuple[float, ...], str]:
            raw = text.strip() or shown  # Enter confirms the numbers as they were shown
            if raw == BACK:  # the run has taken the wish: a motion is not broken off
                raise WireError("the last shot is measured again", remedy="move here first")
            joints = self._read(raw)
            self._require_in_place(joints, target)
            return joints, raw

        self._joints, self._raw = _answer(
            prompt, f"{question}\nwhat does it show? [Enter: the same, {AGAIN}] ", read
        )

    def _read(self, text: str) -> tuple[float, ...]:
        joints = recorded_joints(text, self._layout)
        require_joints("the robot's display", self._layout.joints, joints)
        return joints

    def _require_in_place(self, joints: Sequence[float], target: Sequence[float]) -> None:
        axes = self._layout.joints
        for axis, shown_joint, wanted, limit in zip(
            axes, joints, target, self._settings.in_place, strict=True
        ):
            if not abs(shown_joint - wanted) <= limit:  # so that NaN is refused
                shown = values.outer_units([axis, axis], [abs(shown_joint - wanted), limit])
                raise WireError(
                    f"joint {axis.name} is {shown[0]:.4f} from its target, limit {shown[1]:g} "
                    "(settle.in_place_deg)",
                    remedy="move it there, or correct what was typed",
                )


def _names(axes: Sequence[values.Coordinate]) -> str:
    return " ".join(axis.name for axis in axes)


def _unit(axes: Sequence[values.Coordinate]) -> str:
    """Return the unit of all joints, or one for each where they differ."""
    units = ["deg" if axis.is_angle else "mm" for axis in axes]
    return units[0] if len({*units}) == 1 else " ".join(units)


class TrackerByHand(LaserTracker):
    """A tracker whose points a person types or pastes."""

    def __init__(self, surroundings: Surroundings) -> None:
        self._prompt = surroundings.prompt
        self._serial = str(surroundings.settings)
        self._last: values.Vector3 | None = None

    def connect(self) -> None:
        """Do nothing: there is no wire."""

    reconnect = connect

    @override
    def identity(self) -> values.Identity:
        return values.Identity("operator", "tracker", self._serial, "-", "by hand")

    def prepare(self, reflector: str, measuring_time_s: float) -> None:  # noqa: ARG002
        """Raise `AddressInvalid` where no one can be asked; the rest is its operator's."""
        _require_prompt(self._prompt, "tracker")

    def measure(self) -> values.Measurement:
        """Have a person measure; raises `NotAMeasurement` when no point is given.

        A point equal to the one before, to the last digit, is asked for once more.
        """
        prompt = _require_prompt(self._prompt, "tracker")
        point_mm, raw = _answer(prompt, QUESTION, self._read)
        return values.Measurement(point_mm, None, None, raw)

    def _read(self, text: str) -> tuple[values.Vector3, str]:
        if text.strip() == NO_POINT:
            raise NotAMeasurement("no point was given", remedy="measure it again")
        if text.strip() == BACK:
            raise NotAMeasurement("the last shot is measured again first", remedy="go back to it")
        point_mm, _ = recorded_measurement(text)
        # A tracker hardly measures the same point twice to the last digit. A clipboard that still
        # holds the one before is more likely.
        before, self._last = self._last, point_mm
        if point_mm == before:
            self._last = None  # typed once more, it is confirmed
            raise WireError(
                "this is the point before, to the last digit",
                remedy="copy the new one; if it is right, give it once more",
            )
        return point_mm, text.strip()


def recorded_joints(text: str, layout: RobotLayout) -> tuple[float, ...]:
    """Read joints, rad or mm, from a typed line; raises `WireError`."""
    return values.inner_units(layout.joints, typed_numbers(text, len(layout.joints)))


def recorded_measurement(text: str) -> tuple[values.Vector3, None]:
    """Read a point, mm, from a typed line; raises `DriverError`."""
    point_mm = values.vector(typed_numbers(text, 3))
    require_point("the typed line", point_mm)
    return point_mm, None


class InstrumentByHand:
    """An instrument that a person reads: a touch probe, callipers, an inclinometer."""

    def __init__(self, prompt: Prompt) -> None:
        self._prompt = prompt

    def read(self, task: str, count: int) -> tuple[float, ...] | values.NoValue:
        """Ask for so many numbers, and again while they are none; with 0 for a mark at a place.

        Raises the prompt's `Cancelled`.
        """

        def read(text: str) -> tuple[float, ...] | values.NoValue:
            word = text.strip()
            if word == BACK:
                return values.NoValue.BACK
            if word == (NO_POINT if count == 0 else ""):
                return values.NoValue.SKIPPED
            return typed_numbers(word, count) if count else ()

        keys = f"Enter: done, {NO_POINT}: none" if count == 0 else "Enter: none"
        return _answer(self._prompt, f"{task} [{keys}, {BACK}: the one before again] ", read)
