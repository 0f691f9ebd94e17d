"""pkmcal devices: who answers, in what state, and whether a server keeps its promises."""

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from functools import partial
from typing import Annotated, TypeVar

import typer

from app.console import WARNING, Terminal
from app.interrupt import StopRequest, stop_on_signals
from app.next import tell_next
from app.options import Yes
from app.wiring import connections
from campaigns.campaign import Campaign
from campaigns.errors import OptionsInvalid
from campaigns.measuring.first_contact import ContactTest
from campaigns.settings.sections import BY_HAND
from drivers.errors import DriverError
from drivers.ports import LaserTracker, RobotController

NO_WATCHDOG = (
    "nothing was asked for 3 s, and the robot moved on: its controller has no watchdog. "
    "docs/reference/robotline.md: if the robot moves and no valid line has come for 2 seconds, "
    "stop it as for STOP"
)
Device = TypeVar("Device")
Facts = Mapping[str, object]


@dataclass(frozen=True, slots=True)
class DevicesAnswer:
    """Answer of `devices`: facts about each device, by name."""

    controller: Facts
    tracker: Facts
    motion: Facts | None
    """Facts of the small motion that --move asks for."""


Move = Annotated[
    bool,
    typer.Option("--move", help="Move one joint by 5 % of its range and back, to test the server."),
]


def command(
    terminal: Terminal, campaign: Campaign, *, move: Move = False, yes: Yes = False
) -> None:
    """Connect to both devices and show their state.

    Nothing moves without --move.

    Connects to controller and tracker, one after the other, and shows identities, joints, faults,
    the tracker's start-up, beam, reflectors and weather. campaign.yaml needs some of these: serial
    numbers and the reflector's name. If one device fails, the other is still asked. Refused while
    a run is under way, which it would disturb.

    --move is for the first contact with a controller's server. It asks first; then one joint moves
    by 5 % of its range and back, slowly and by a checked way. Refused is a server that reports
    targets for encoders, or rest during the motion. Nothing is asked for 3 s on the way back: a
    warning says where no watchdog stops the robot then. Ctrl-C stops it at once.
    """
    if move and campaign.config.controller.url == BY_HAND:
        raise OptionsInvalid(
            "--move: nothing but its operator moves this robot",
            remedy="leave --move out; it tests controllers that pkmcal moves",
        )
    # both are asked and shown before the first error is raised: a technician sees at once whether
    # one device is wrong or the network
    with campaign.held(), connections(campaign) as to:
        controller = _ask(to.robot, partial(facts_of_controller, campaign))
        tracker = _ask(to.tracker, partial(facts_of_tracker, campaign))
    _show(terminal, f"controller at {campaign.config.controller.url}", controller)
    _show(terminal, f"tracker at {campaign.config.tracker.url}", tracker)
    if isinstance(controller, DriverError):
        raise controller
    if isinstance(tracker, DriverError):
        raise tracker
    motion = _motion(terminal, campaign, yes=yes) if move else None
    following = tell_next(terminal, campaign, answered=True)
    terminal.conclude(DevicesAnswer(controller, tracker, motion), following)


def _motion(terminal: Terminal, campaign: Campaign, *, yes: bool) -> Facts:
    """Test the controller by a small motion, show what it was like, and return the facts."""
    question = "One joint moves by 5 % of its range and back, slowly. Is the cell clear?"
    terminal.require_yes(question, yes=yes)
    stop, axes = StopRequest(), campaign.robot.mechanism.joints
    ways = connections(campaign, stop, terminal.alarm)
    with campaign.held(), stop_on_signals(stop), ways as to, to.robot() as robot:
        robot.prepare()
        clock, settle = to.interruptible(to.controller.clock), campaign.config.settle
        contact = ContactTest(robot, clock, campaign.robot_model, settle, stop).move()
    axis = axes[contact.joint]
    facts = {
        "joint": contact.joint,
        f"travel_{axis.unit}": round(axis.to_file(contact.travel), 6),
        "stops_unasked": contact.has_watchdog,
    }
    _show(terminal, "motion", facts)
    if contact.has_watchdog is False:
        terminal.say(NO_WATCHDOG, WARNING)
    return facts


def _show(terminal: Terminal, title: str, facts: Facts | DriverError) -> None:
    if isinstance(facts, DriverError):
        terminal.listing(title, {"failed": str(facts)})
    else:
        lines = {name.replace("_", " "): _text(value) for name, value in facts.items()}
        terminal.listing(title, lines)


def _ask(
    connect: Callable[[], AbstractContextManager[Device]], facts_of: Callable[[Device], Facts]
) -> Facts | DriverError:
    """Return facts about a device, or the error that prevented it."""
    try:
        with connect() as device:
            return facts_of(device)
    except DriverError as error:
        return error


def facts_of_controller(campaign: Campaign, robot: RobotController) -> Facts:
    """Return identity, joints and faults of the controller.

    Joints are a list, or one fact each where some are in deg and others in mm.
    """
    identity, state = robot.identity(), robot.state()
    axes = campaign.robot.mechanism.joints
    # a robot that is moved by hand has no joints before the operator has typed them
    read = zip(axes, state.joints, strict=bool(state.joints))
    joints = {axis.column: round(axis.to_file(value), 6) for axis, value in read}
    is_alike = len({axis.unit for axis in axes}) == 1
    return {
        "identity": str(identity),
        "serial": identity.serial,
        **({f"joints_{axes[0].unit}": [*joints.values()]} if is_alike else joints),
        "moving": state.moving,
        "fault": state.fault,
        "emergency_stop": state.emergency_stop,
    }


def facts_of_tracker(campaign: Campaign, tracker: LaserTracker) -> Facts:
    """Return identity and state of the tracker, its reflectors, and the weather."""
    identity, state, air = tracker.identity(), tracker.state(), tracker.weather()
    return {
        "identity": str(identity),
        "serial": identity.serial,
        **_file_of(campaign),
        "readiness": state.readiness.value,
        "initialised": state.initialised,
        "laser_warm": state.laser_warm,
        "beam_locked": state.beam_locked,
        "reflector": state.reflector,
        "ignored_packets": state.ignored_packets,
        "reflectors": [reflector.name for reflector in tracker.reflectors()],
        "temperature_degC": air and air.temperature_degC,
        "pressure_hPa": air and air.pressure_hPa,
        "humidity_percent": air and air.humidity_percent,
    }


def _file_of(campaign: Campaign) -> Facts:
    """Return the file into which the tracker's software writes, and whether it is there."""
    path = campaign.watched_file
    if path is None:
        return {}
    return {"file": str(path) if path.exists() else f"{path}, not there yet"}


def _text(value: object) -> str:
    """Return a fact for people: yes or no, unknown, none."""
    if isinstance(value, bool):  # before float: a bool is a number, too
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "none"
    if isinstance(value, float):
        return f"{value:g}"
    return "unknown" if value is None else str(value) or "none"
