"""Real or simulated: the one place that knows concrete drivers and the simulator."""

import json
import random
import shlex
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from campaigns.campaign import SIMULATED, Campaign
from campaigns.controllers.active_kinematics import ActiveKinematics
from campaigns.controllers.linuxcnc_export import (
    CalibrationFile,
    RobotIdentity,
    drawing_flat,
    parameter_pins,
    pin_of,
)
from campaigns.errors import ConfigInvalid, WriteFailed
from campaigns.files.text_file import replace_text
from campaigns.journal.inspection import RawReaders
from campaigns.measuring.work import Cell as Devices
from campaigns.mechanisms.mechanism import Mechanism
from campaigns.settings.config import CampaignConfig
from campaigns.settings.sections import LinuxcncConfig
from drivers.bounded_files import (
    CSV_BYTES,
    FileRefused,
    decoded,
    is_file,
    is_there,
    read_bounded,
)
from drivers.byte_log import ByteLog, logged, reading_for
from drivers.emscon.tracker import EmsconTracker
from drivers.errors import (
    BeamBroken,
    DriverError,
    LimitViolation,
    MotionFault,
    WrongDevice,
)
from drivers.geocom.tracker import GeocomTracker
from drivers.link import never
from drivers.linuxcnc.hal_parameters import FileParameters, HalAccess, HalParameters, HalPins
from drivers.linuxcnc.robot import LinuxcncRobot
from drivers.linuxcnc.settings import (
    Coordinates,
    JointLimits,
    LinuxcncSettings,
    MachineAxes,
    ParameterStore,
    Passwords,
)
from drivers.polling import WakefulClock
from drivers.ports import Clock, LaserTracker, RobotController, SystemClock
from drivers.raw_answers import joints_said, measurement_said
from drivers.robotline.robot import LineRobot
from drivers.stopping import Alarm, unheard
from drivers.transport import CONNECT_S, Opener, Transport, open_transport
from drivers.values import Identity
from drivers.wire.robotline import LAST_SEQUENCE, RobotLayout
from sim.cell import Cell
from sim.clock import ScaledClock
from sim.embedded import EmbeddedCell
from sim.errors import MemoryInvalid
from sim.scenarios.scenario import load_scenario
from sim.scenarios.schema import Scenario

CELL_MEMORY = "cell-memory.json"
MEMORY_BYTES = CSV_BYTES
"""A line or two for each place at which the cell has ever stood."""
FIRST_TRANSACTIONS = (1000, 30_000)
"""Where the question numbers of a GeoCOM session may begin: differently from one to the next."""

StopRequested = Callable[[], bool]
Reading = Callable[[Opener], Opener]


@dataclass(frozen=True, slots=True)
class Operator:
    """Whoever may want to stop, and has to read an alarm at once."""

    stop_requested: StopRequested = never
    alarm: Alarm = unheard


NOBODY = Operator()
"""Where nothing moves that could be stopped."""


@dataclass(frozen=True, slots=True)
class Addresses:
    """Where the devices answer, and the time they live in."""

    controller: str
    tracker: str
    clock: Clock
    tracker_clock: Clock | None = None
    """Time as a simulated tracker of ours lives it; None for one that is not served here."""


def scenario_of(campaign_folder: Path, url: str) -> Scenario:
    """The scenario that a sim:// URL names: a file of the campaign's folder, or a shipped one."""
    name = url.removeprefix(SIMULATED)
    own = campaign_folder / f"{name}.yaml"
    return load_scenario(str(own) if is_file(own) else name)


@contextmanager
def connected_cell(
    campaign: Campaign, operator: Operator = NOBODY, log: ByteLog | None = None
) -> Iterator[Devices]:
    """Both devices, connected; closed at the end of the block. `log` gets every byte.

    Once a stop is requested, nothing is waited for any more. Raises a driver's error when one is
    not there or not the expected one.
    """
    with (
        doors(campaign, operator, log) as each,
        each.robot() as robot,
        each.tracker() as tracker,
    ):
        clock = WakefulClock(each.clock, operator.stop_requested)
        yield Devices(robot, tracker, clock, SystemClock())


@dataclass(frozen=True, slots=True)
class Doors:
    """Ways to each device by itself: connected for the time of a block; and their cell's time.

    Entering raises a driver's error when the device is not there or not the expected one.
    """

    robot: Callable[[], AbstractContextManager[RobotController]]
    tracker: Callable[[], AbstractContextManager[LaserTracker]]
    clock: Clock


@contextmanager
def doors(
    campaign: Campaign, operator: Operator = NOBODY, log: ByteLog | None = None
) -> Iterator[Doors]:
    """Ways to each device; a simulated cell is served for the time of the block."""
    config = campaign.config
    to_robot = _logging(campaign, log, "controller", config.controller.driver)
    to_tracker = _logging(campaign, log, "tracker", config.tracker.driver)
    with _addresses(campaign) as at:
        yield Doors(
            partial(_robot, campaign, at, _opener(at.controller, to_robot), operator),
            partial(_tracker, config, at, _opener(at.tracker, to_tracker), operator.stop_requested),
            at.clock,
        )


@contextmanager
def connected_robot(campaign: Campaign) -> Iterator[RobotController]:
    """The controller alone."""
    with doors(campaign) as each, each.robot() as robot:
        yield robot


def prepare(campaign: Campaign, cell: Devices) -> None:
    """Bring tracker and robot into the state that measuring needs.

    The robot may move: homing is part of it.
    """
    tracker = campaign.config.tracker
    cell.tracker.prepare(tracker.reflector, tracker.measuring_time_s)
    cell.robot.prepare()


@contextmanager
def _addresses(campaign: Campaign) -> Iterator[Addresses]:
    """The URLs to connect to; a simulated cell is started for the time of the block."""
    controller, tracker = campaign.config.controller.url, campaign.config.tracker.url
    simulated = [url for url in (controller, tracker) if url.startswith(SIMULATED)]
    if not simulated:
        yield Addresses(controller, tracker, SystemClock())
        return
    if len(set(simulated)) > 1:
        raise ConfigInvalid(
            f"controller and tracker are of two simulated cells: {' and '.join(simulated)}",
            remedy="give both the same sim:// address",
        )
    with _embedded(campaign, simulated[0]) as cell:
        yield Addresses(
            cell.controller_url if controller in simulated else controller,
            cell.tracker_url if tracker in simulated else tracker,
            cell.clock if controller in simulated else SystemClock(),
            cell.clock if tracker in simulated else None,
        )


def require_same_mechanism(campaign: Campaign, scenario: Scenario) -> None:
    """Raise `ConfigInvalid` for a cell of another mechanism than the campaign's robot."""
    if campaign.robot.mechanism.name != scenario.robot.kind.name:
        raise ConfigInvalid(
            f"the simulated cell {scenario.name} is a {scenario.robot.kind.name}, but this "
            f"campaign's robot is a {campaign.robot.mechanism.name}",
            remedy="make a new campaign with `pkmcal new DIR --robot FILE`, whose cell is of it",
        )


@contextmanager
def _embedded(campaign: Campaign, url: str) -> Iterator[EmbeddedCell]:
    """A simulated cell that remembers, in the campaign's folder, what a real one would remember."""
    path = campaign.path(CELL_MEMORY)
    scenario = scenario_of(campaign.folder, url)
    require_same_mechanism(campaign, scenario)
    cell = Cell(scenario, memory=_remembered(path))
    speaks = campaign.config.tracker.driver
    with EmbeddedCell(cell, ScaledClock(scenario.speed_up), tracker_speaks=speaks) as embedded:
        try:
            yield embedded
        except BaseException:
            with suppress(WriteFailed):  # what went wrong first is what counts
                _remember(path, embedded)
            raise
        _remember(path, embedded)


def _remember(path: Path, embedded: EmbeddedCell) -> None:
    replace_text(path, json.dumps(embedded.memory(), indent=1))


def _remembered(path: Path) -> dict[str, object] | None:
    if not is_there(path):
        return None
    try:
        found = json.loads(decoded(read_bounded(path, MEMORY_BYTES), str(path)))
    except (FileRefused, RecursionError, ValueError) as error:
        raise MemoryInvalid(
            f"{path}: cannot be read ({error})", remedy="delete the file"
        ) from error
    if not isinstance(found, dict):
        raise MemoryInvalid(f"{path}: holds no memory of a cell", remedy="delete the file")
    return found


def _opener(url: str, within: Reading | None = None) -> Opener:
    def opened(*, timeout_s: float = CONNECT_S) -> Transport:
        return open_transport(url, timeout_s=timeout_s)

    return opened if within is None else within(opened)


def _logging(campaign: Campaign, log: ByteLog | None, device: str, driver: str) -> Reading | None:
    """What writes every byte of a device into the log, read out by its driver's grammar."""
    if log is None:
        return None
    reading = reading_for(driver, _layout(campaign))
    return lambda opener: logged(opener, log, device, reading)


@contextmanager
def _named(
    device: str, url: str, own: tuple[type[DriverError], ...]
) -> Iterator[Callable[[Identity], None]]:
    """Name a device in every error that is about it: which one, its address, its serial number.

    That is one that says its address, or one of its `own` kinds. The block is given what to tell
    who answered.
    """
    names = [device]

    def greeted(identity: Identity) -> None:
        names[:] = [f"{device} {identity.serial}"]

    try:
        yield greeted
    except DriverError as error:
        if url and url in error.problem:
            error.problem = error.problem.replace(url, f"{names[0]} at {url}", 1)
        elif isinstance(error, own):
            error.problem = f"{names[0]} at {url}: {error.problem}"
        raise


@contextmanager
def _robot(
    campaign: Campaign, at: Addresses, opener: Opener, operator: Operator = NOBODY
) -> Iterator[RobotController]:
    robot = _made_robot(campaign, opener, operator)
    try:
        with _named("controller", at.controller, (MotionFault, LimitViolation)) as greeted:
            robot.connect()
            greeted(identity := robot.identity())
            _check_serial("controller", identity, campaign.config.controller.serial)
            yield robot
    finally:
        robot.close()


def _made_robot(
    campaign: Campaign, opener: Opener, operator: Operator
) -> LineRobot | LinuxcncRobot:
    if campaign.config.controller.driver == "linuxcnc":
        section = campaign.config.controller.linuxcnc
        assert section is not None, "its settings were checked"
        return linuxcnc_robot(campaign, section, opener, operator)
    return LineRobot(
        opener,
        layout=_layout(campaign),
        clock=SystemClock(),
        first_sequence=random.SystemRandom().randint(1, LAST_SEQUENCE),
        cancelled=operator.stop_requested,
        alarm=operator.alarm,
    )


def raw_readers(campaign: Campaign) -> RawReaders:
    """Readers of the raw answers that a campaign's journal keeps."""
    layout = _layout(campaign)
    return RawReaders(lambda driver, raw: joints_said(driver, raw, layout), measurement_said)


def _layout(campaign: Campaign) -> RobotLayout:
    """Names of the robot's joints, coordinates and parameters, as the wire has them."""
    mechanism = campaign.robot.mechanism
    joints, task = (
        tuple(axis.column for axis in axes) for axes in (mechanism.joints, mechanism.task)
    )
    return RobotLayout(joints, task, mechanism.parameters.names, mechanism.parameters.extensions)


@contextmanager
def _tracker(
    config: CampaignConfig, at: Addresses, opener: Opener, stop_requested: StopRequested
) -> Iterator[LaserTracker]:
    tracker = _made_tracker(config.tracker.driver, at.tracker_clock, opener, stop_requested)
    try:
        with _named("tracker", at.tracker, (BeamBroken,)) as greeted:
            tracker.connect()
            greeted(identity := tracker.identity())
            _check_serial("tracker", identity, config.tracker.serial)
            yield tracker
    finally:
        tracker.close()


def _made_tracker(
    driver: str, tracker_clock: Clock | None, opener: Opener, stop_requested: StopRequested
) -> EmsconTracker | GeocomTracker:
    clock = WakefulClock(SystemClock(), stop_requested)
    if driver == "emscon":
        return EmsconTracker(
            opener,
            clock=clock,
            cancelled=stop_requested,
            instrument_clock=tracker_clock,
        )
    first = random.SystemRandom().randint(*FIRST_TRANSACTIONS)
    return GeocomTracker(opener, clock=clock, first_transaction=first, cancelled=stop_requested)


def _check_serial(device: str, found: Identity, expected: str | None) -> None:
    if expected is not None and found.serial != expected:
        raise WrongDevice(
            f"the {device} has serial number {found.serial}, campaign.yaml expects {expected}",
            remedy=f"connect the right {device}, or correct {device}.serial in campaign.yaml",
        )


ACTIVE = "linuxcnc-active.hal"
"""The parameters in use where LinuxCNC has none itself; in the campaign's folder."""


def linuxcnc_robot(
    campaign: Campaign,
    section: LinuxcncConfig,
    opener: Opener,
    operator: Operator = NOBODY,
) -> LinuxcncRobot:
    """The driver for this campaign's LinuxCNC; nothing is opened yet."""
    axes = _machine_axes(campaign.robot.mechanism)
    settings = LinuxcncSettings(
        Coordinates[section.coordinates.upper()],
        JointLimits(*campaign.robot.limits.joint, axes),
        section.full_speed_rad_s if axes.are_rotary else section.full_speed_mm_per_s,
        passwords=Passwords(section.connect_password, section.enable_password),
    )
    return LinuxcncRobot(
        opener,
        clock=SystemClock(),
        settings=settings,
        store=_store(campaign, section),
        kinematics_of=partial(ActiveKinematics, campaign.robot.mechanism),
        cancelled=operator.stop_requested,
        alarm=operator.alarm,
    )


def _store(campaign: Campaign, section: LinuxcncConfig) -> ParameterStore:
    nominal = campaign.robot
    whose = RobotIdentity(campaign.robot_identity, nominal)
    path = campaign.folder / (section.hal_file or ACTIVE)
    if section.coordinates == "joints":
        return FileParameters(CalibrationFile(path, whose, otherwise=nominal))
    access = HalAccess(prefix=tuple(shlex.split(section.beside)))
    pins = parameter_pins(nominal.mechanism)
    drawing = {pin_of(name): value for name, value in drawing_flat(nominal.mechanism).items()}
    return HalParameters(
        CalibrationFile(path, whose),
        HalPins((*pins.values(), *drawing), access),
        pins,
        frozenset(nominal.mechanism.parameters.extensions),
        drawing,
    )


def _machine_axes(mechanism: Mechanism) -> MachineAxes:
    return MachineAxes(
        mechanism.name.capitalize(),
        len(mechanism.joints),
        mechanism.joints[0].is_revolute,
        any(axis.is_revolute for axis in mechanism.task),
    )
