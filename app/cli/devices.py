"""pkmcal devices: who answers, and in what state."""

import logging
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, TypeVar

import typer
from typing_extensions import override

from app.console import Terminal
from app.next import tell_next
from app.wiring import connections
from campaigns.campaign import Campaign
from campaigns.errors import WriteFailed
from campaigns.files.text_file import refuse_existing
from drivers.byte_log import LOGGER
from drivers.errors import DriverError
from drivers.ports import LaserTracker, RobotController

Device = TypeVar("Device")
Facts = Mapping[str, object]


@dataclass(frozen=True, slots=True)
class DevicesAnswer:
    """Answer of `devices`: what each device says of itself, by name."""

    controller: Facts
    tracker: Facts


def command(
    terminal: Terminal,
    campaign: Campaign,
    *,
    spy: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Log every byte, as text or hexadecimal, to a new file."),
    ] = None,
) -> None:
    """Connect to both devices and show their state; nothing moves.

    Connects to controller and tracker, one after the other, and shows identities, joints, faults,
    the tracker's start-up, beam, reflectors and weather. campaign.yaml needs some of these: serial
    numbers and the reflector's name. If one device fails, the other is still asked. Refused while
    a run is under way, which it would disturb.
    """
    with campaign.held(), _byte_log(spy), connections(campaign) as to:
        controller = _asked(to.robot, partial(of_controller, campaign))
        tracker = _asked(to.tracker, of_tracker)
    _show(terminal, f"controller at {campaign.config.controller.url}", controller)
    _show(terminal, f"tracker at {campaign.config.tracker.url}", tracker)
    if isinstance(controller, DriverError):
        raise controller
    if isinstance(tracker, DriverError):
        raise tracker
    following = tell_next(terminal, campaign)
    terminal.conclude(DevicesAnswer(controller, tracker), following)


def _show(terminal: Terminal, title: str, facts: Facts | DriverError) -> None:
    if isinstance(facts, DriverError):
        terminal.listing(title, {"failed": str(facts)})
    else:
        words = {name.replace("_", " "): _text(value) for name, value in facts.items()}
        terminal.listing(title, words)


class _LogFile(logging.FileHandler):
    """A new file of log records with their time in UTC."""

    @override
    def handleError(self, record: logging.LogRecord) -> None:
        """End the command: nothing moves by it."""
        raise _unwritable(self.baseFilename, sys.exception())


@contextmanager
def _byte_log(path: Path | None) -> Iterator[None]:
    """Log every byte into a new file for the time of the block, if one is named.

    Raises `OutputExists` or `WriteFailed`.
    """
    if path is None:
        yield
        return
    refuse_existing(path)
    try:
        file = _LogFile(path, mode="x", encoding="utf-8")
    except OSError as error:
        raise _unwritable(path, error) from error
    form = logging.Formatter("{asctime}.{msecs:03.0f}Z {message}", "%Y-%m-%dT%H:%M:%S", style="{")
    form.converter = time.gmtime
    file.setFormatter(form)
    LOGGER.addHandler(file)
    LOGGER.setLevel(logging.DEBUG)
    try:
        yield
    finally:
        LOGGER.setLevel(logging.NOTSET)
        LOGGER.removeHandler(file)
        with suppress(OSError):  # the same as that of the last record
            file.close()


def _unwritable(path: object, error: BaseException | None) -> WriteFailed:
    return WriteFailed(f"{path}: cannot be written ({error})", remedy="name another file")


def _asked(
    door: Callable[[], AbstractContextManager[Device]], facts_of: Callable[[Device], Facts]
) -> Facts | DriverError:
    """Return what a device states, or the error for which it states nothing."""
    try:
        with door() as device:
            return facts_of(device)
    except DriverError as error:
        return error


def of_controller(campaign: Campaign, robot: RobotController) -> Facts:
    """Return what the controller states."""
    identity, state = robot.identity(), robot.state()
    axes = campaign.robot.mechanism.joints
    joints = zip(axes, state.joints, strict=bool(state.joints))  # by hand: none until asked
    return {
        "identity": str(identity),
        "serial": identity.serial,
        f"joints_{axes[0].unit}": [round(axis.to_file(value), 6) for axis, value in joints],
        "moving": state.moving,
        "fault": state.fault,
        "emergency_stop": state.emergency_stop,
    }


def of_tracker(tracker: LaserTracker) -> Facts:
    """Return what the tracker states, and the weather."""
    identity, state, air = tracker.identity(), tracker.state(), tracker.weather()
    return {
        "identity": str(identity),
        "serial": identity.serial,
        "readiness": state.readiness.value,
        "initialised": state.initialised,
        "laser_warm": state.laser_warm,
        "beam_locked": state.beam_locked,
        "reflector": state.reflector,
        "packets_passed_over": state.packets_passed_over,
        "reflectors": [reflector.name for reflector in tracker.reflectors()],
        "temperature_degC": air and air.temperature_degC,
        "pressure_hPa": air and air.pressure_hPa,
        "humidity_percent": air and air.humidity_percent,
    }


def _text(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, list):
        return ", ".join(map(str, value)) or "none"
    if isinstance(value, float):
        return f"{value:g}"
    return "unknown" if value is None else str(value) or "none"
