"""A robot that a person moves (docs/by-hand.md): joints are shown, the display's are typed."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass

from typing_extensions import override

from drivers.by_hand.asking import answered, identity, require_somebody
from drivers.declaration import ControllerDriver, RobotSurroundings
from drivers.errors import DeviceRefused, WireError
from drivers.plausible import require_joints
from drivers.ports import Prompt, RobotController
from drivers.values import Identity, Pose, RobotState, inner_units, outer_units
from drivers.wire.robotline import RobotLayout
from drivers.wire.typed_numbers import typed_numbers, written_numbers

DECIMALS = 4
"""Of joints as they are shown: 0.0001° is 2 µm at a metre."""
GEOMETRY_DECIMALS = 6
PLACE = "the robot's display"


@dataclass(frozen=True, slots=True, kw_only=True)
class HandSettings:
    """Facts about a robot that a person moves."""

    serial: str
    in_place: tuple[float, ...]
    """Largest distance of each joint from its target, rad or mm."""
    read: Callable[[], Mapping[str, float]]
    """The parameters that the controller holds, as they were typed in last; the nominal ones."""
    write: Callable[[Mapping[str, float]], None]
    """Keep what has been typed into the controller."""
    lacks: Callable[[Collection[str]], tuple[str, ...]]
    joints_of: Callable[[Mapping[str, float], Pose], tuple[float, ...]]
    """Joints of a pose by a parameter set; raises `LimitViolation`."""


class RobotByHand(RobotController):
    """A robot of which nothing is known but what its display shows and somebody types."""

    def __init__(self, layout: RobotLayout, prompt: Prompt | None, settings: HandSettings) -> None:
        self._layout = layout
        self._prompt = prompt
        self._settings = settings
        self._joints: tuple[float, ...] | None = None
        self._raw = ""

    @override
    def connect(self) -> None:
        self._joints = None

    reconnect = connect

    @override
    def identity(self) -> Identity:
        return identity("robot", self._settings.serial)

    def state(self) -> RobotState:
        """Joints as typed last; asked for where none were, and empty where nobody can be asked."""
        if self._joints is None and self._prompt is not None:
            self._ask("where is the robot? type the joints that its display shows", None)
        joints = self._joints or ()
        return RobotState(joints, moving=False, fault="", emergency_stop=False, raw=self._raw)

    @override
    def prepare(self) -> None:
        require_somebody(self._prompt, "controller")

    def move_joints(self, joints: Sequence[float], speed_fraction: float) -> None:  # noqa: ARG002
        """Have somebody go there; asked again while the display shows another place."""
        self._ask("move the robot", tuple(joints))

    def move_pose(self, pose: Pose, speed_fraction: float) -> None:  # noqa: ARG002
        """Have somebody go to a pose by the controller's own kinematics.

        The joints to expect are those of the parameters that it holds.
        """
        shown = outer_units(self._layout.coordinates, pose.coordinates)
        each = zip(self._layout.coordinates, shown, strict=True)
        place = " ".join(f"{a.name} {v:.3f}{' °' if a.is_angle else ' mm'}" for a, v in each)
        target = self._settings.joints_of(self._settings.read(), pose)
        self._ask(f"move the robot to the pose {place}, by its controller's own kinematics", target)

    def stop(self) -> None:
        """Do nothing: whoever moves the robot stands beside it."""

    @override
    def read_geometry(self) -> Mapping[str, float]:
        return self._settings.read()

    @override
    def lacks(self, names: Collection[str]) -> tuple[str, ...]:
        return self._settings.lacks(names)

    @override
    def write_geometry(self, geometry: Mapping[str, float]) -> None:
        prompt = require_somebody(self._prompt, "controller")
        lines = (f"  {name:<32}{value:.{GEOMETRY_DECIMALS}f}" for name, value in geometry.items())
        asked = "type these parameters into the robot's controller:\n" + "\n".join(lines)
        if prompt(f"{asked}\nhas it taken all of them? [y/N] ").lower() not in {"y", "yes"}:
            raise DeviceRefused(
                "nobody has typed the parameters into the controller",
                remedy="load again when somebody can; put back by hand what was changed meanwhile",
            )
        self._settings.write(geometry)

    def close(self) -> None:
        """Do nothing: there is no wire."""

    def _ask(self, doing: str, target: tuple[float, ...] | None) -> None:
        prompt = require_somebody(self._prompt, "controller")
        axes = self._layout.joints
        names = " ".join(axis.name for axis in axes)
        unit = "deg" if axes[0].is_angle else "mm"
        shown = "" if target is None else written_numbers(outer_units(axes, target), DECIMALS)
        question = f"{doing}: {names}, {unit}"
        if target is not None:
            question = f"{doing}, {names} = {shown} {unit}\nwhat does it show? [Enter: the same]"

        def read(text: str) -> None:
            raw = text.strip() or shown
            joints = inner_units(axes, typed_numbers(raw, len(axes)))
            require_joints(PLACE, axes, joints)
            if target is not None:
                self._require_there(joints, target)
            self._joints, self._raw = joints, raw

        answered(prompt, f"{question} ", read)

    def _require_there(self, joints: Sequence[float], target: Sequence[float]) -> None:
        axes = self._layout.joints
        away = [abs(here - there) for here, there in zip(joints, target, strict=True)]
        for axis, off, most in zip(axes, away, self._settings.in_place, strict=True):
            if not off <= most:
                (far,), (limit,) = (outer_units([axis], [size]) for size in (off, most))
                raise WireError(
                    f"joint {axis.name} is {far:.4f} from its target, limit {limit:g} "
                    "(settle.in_place_deg)",
                    remedy="move it there, or correct what was typed",
                )


def joints_said(raw: str, layout: RobotLayout) -> tuple[float, ...]:
    """Joint values, rad or mm, of a line as records keep it; raises `WireError`."""
    return inner_units(layout.joints, typed_numbers(raw, len(layout.joints)))


def _made(given: RobotSurroundings) -> RobotByHand:
    settings = given.own()
    assert isinstance(settings, HandSettings), "the campaign has them for this driver"
    return RobotByHand(given.layout, given.prompt, settings)


DRIVER = ControllerDriver(_made, joints_said)
