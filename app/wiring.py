"""Real or simulated: the one place where a campaign's devices are made and connected."""

# From the addresses in campaign.yaml to two ports that answer:
#
# - `connections` decides what lies behind each address. tcp://, serial:// and file: are real. For
#   sim://NAME it starts a simulated cell in this process, alive for the time of the block, and
#   connects by a pipe. Above the pipe all is alike: the same driver, the same wire protocol.
# - `DevicePlace` says where a device answers and by which clock it is judged: real devices by the
#   system's, a simulated cell by its own. Event time lets a simulated hour pass in seconds.
# - `DeviceConnections.robot` and `.tracker` make the driver of the catalogue, connect it, check
#   its serial number against campaign.yaml and close it at the end of the block.
# - One real and one simulated device make a rehearsal: the real robot's joints are handed on to
#   the simulated one, so that the simulated tracker measures a robot that stands there.

import json
import math
import random
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Literal, cast

from app.own_equations import OwnEquations
from campaigns.campaign import Campaign
from campaigns.controllers.active_kinematics import HeldParameters, joints_of_pose
from campaigns.controllers.issuer import IDENTITY, is_foreign
from campaigns.errors import ConfigInvalid, JournalFailed, ShotsMissing, WriteFailed
from campaigns.files.text_file import replace_text
from campaigns.fit.kinds import KINDS
from campaigns.identification.observed import objects_of
from campaigns.measuring.instruments import Instrument, Task
from campaigns.measuring.reflector_places import place_of
from campaigns.measuring.work import Devices, RawReaders
from campaigns.settings.sections import BY_HAND, SIMULATED
from campaigns.shots import point_files
from campaigns.shots.point_layout import PointFormat
from drivers import bounded_files, errors
from drivers.by_hand import HandSettings, InstrumentByHand
from drivers.catalog import CONTROLLERS, TRACKERS
from drivers.declaration import RobotSurroundings, Surroundings
from drivers.link import never
from drivers.polling import WakefulClock
from drivers.ports import Clock, LaserTracker, Prompt, RobotController, SystemClock
from drivers.stopping import Alarm, unheard
from drivers.transport import CONNECT_S, Opener, Transport, opener_of
from drivers.values import Coordinate, Identity, Pose, RobotState
from drivers.watch_file import WatchSettings
from drivers.wire.lines import LAST_NUMBER
from drivers.wire.robotline import RobotLayout
from sim.cell import Cell
from sim.clock import EventClock, ScaledClock
from sim.errors import SimError
from sim.faults import DeviceName
from sim.in_process import InProcessCell
from sim.instruments import ReadObject
from sim.robot.controller import SimulatedController
from sim.scenarios.scenario import load_scenario
from sim.scenarios.schema import Scenario

CELL_MEMORY = "cell-memory.json"
MEMORY_BYTES = bounded_files.CSV_BYTES
"""A line or two for each place at which the cell has ever stood."""

HOLDER_STD_MM = 5.0
"""Largest 1 σ by which a simulated holder is off the place that campaign.yaml states."""

StopRequested = Callable[[], bool]


def scenario_of(campaign_folder: Path, url: str) -> Scenario:
    """Return the scenario of a sim:// URL: a file of the campaign's folder, or a shipped one."""
    return load_scenario(_scenario_source(campaign_folder, url))


def _scenario_source(campaign_folder: Path, url: str) -> str:
    name = url.removeprefix(SIMULATED)
    cell_file = campaign_folder / f"{name}.yaml"
    return str(cell_file) if bounded_files.is_file(cell_file) else name


@contextmanager
def connected_cell(
    campaign: Campaign,
    stop_requested: StopRequested = never,
    alarm: Alarm = unheard,
    prompt: Prompt | None = None,
    announce: Alarm = unheard,
) -> Iterator[Devices]:
    """Connect controller and tracker for the time of a `with` block.

    Args:
        campaign: The campaign, whose campaign.yaml has the devices' addresses and drivers.
        stop_requested: Returns True when all waits shall end.
        alarm: Receives what the operator has to read at once.
        prompt: Asks the operator, for devices that are worked by hand.
        announce: Receives what the operator of such a device has to do now.

    Returns:
        The cell: `robot`, `tracker` and clocks, for the steps in `workflow`.

    Raises:
        DriverError: A device does not answer, or is not the expected one.

    Example:
        >>> with connected_cell(campaign) as cell:
        ...     prepare(campaign, cell)
        ...     workflow.run(campaign, cell)
    """
    ways = connections(campaign, stop_requested, alarm, prompt, announce)
    with ways as to, to.robot() as robot, to.tracker() as tracker:
        # the robot settles in the controller's time, the operator waits in the wall clock's
        clocks = to.interruptible(to.controller.clock), SystemClock()
        devices = Devices(robot, tracker, *clocks, raw_readers=_raw_readers(campaign))
        if to.cell is not None:
            devices = replace(
                devices,
                carry=partial(_carry, campaign, to.cell),
                instrument=partial(_read_instrument, campaign, to.cell),
            )
        yield devices


@dataclass(frozen=True, slots=True)
class DevicePlace:
    """Address of a device, how to open it, and the clock by which its answers are judged."""

    url: str
    open_transport: Opener
    clock: Clock
    first_number: int
    """Number of a session's first question, where the protocol numbers them."""
    in_process: bool = False
    """Whether it is simulated in this process."""

    @classmethod
    def real(cls, url: str) -> "DevicePlace":
        """Return the place of a device outside this process."""
        return cls(url, opener_of(url), SystemClock(), _first_question_number())

    @classmethod
    def simulated(cls, cell: InProcessCell, device: DeviceName, url: str) -> "DevicePlace":
        """Return the place of a device of a cell that is simulated in this process."""
        name = f"{url}/{device}"

        def open_pipe(*, timeout_s: float = CONNECT_S) -> Transport:  # noqa: ARG001 - at once
            return cell.connect(device, name)

        # no earlier session can have left an answer in a new pipe: questions count from 1
        return cls(name, open_pipe, cell, 1, in_process=True)


@dataclass(frozen=True, slots=True)
class DeviceConnections:
    """Ways to each device by itself: connected for the time of a block.

    Entering raises a driver's error when the device does not answer or is not the expected one.
    """

    campaign: Campaign
    stop_requested: StopRequested
    alarm: Alarm
    prompt: Prompt | None
    """Asks the operator, for devices that he works by hand; None without a terminal."""
    announce: Alarm
    controller: DevicePlace
    tracker_place: DevicePlace
    followed: SimulatedController | None = None
    """Takes the real robot's joints: the simulated tracker measures a robot that stands there."""
    cell: InProcessCell | None = None
    """Simulated cell of which the tracker is; None: the tracker is real."""

    @contextmanager
    def robot(self) -> Iterator[RobotController]:
        """Connect the controller for the time of the block."""
        driver = CONTROLLERS[self.campaign.config.controller.driver]
        layout = _layout(self.campaign)
        robot = driver.make(
            RobotSurroundings(
                open_transport=self.controller.open_transport,
                clock=self.controller.clock,
                cancelled=self.stop_requested,
                first_number=self.controller.first_number,
                settings=_hand_settings(self.campaign),
                prompt=self.prompt,
                layout=layout,
                alarm=self.alarm,
                in_process=self.controller.in_process,
            )
        )
        serial = self.campaign.config.controller.serial
        # these errors are about this robot although they do not state its address
        about_robot = errors.MotionFault, errors.LimitViolation
        try:
            with _naming("controller", self.controller.url, about_robot) as name_by:
                robot.connect()
                name_by(identity := robot.identity())
                _check_serial("controller", identity, serial)
                if not layout.has_movep and driver is not CONTROLLERS[BY_HAND]:
                    robot = cast("RobotController", _MovedByJoints(robot, self.campaign))
                if self.followed is not None:
                    robot = cast("RobotController", _FollowedRobot(robot, self.followed))
                yield robot
        finally:
            robot.close()

    @contextmanager
    def tracker(self) -> Iterator[LaserTracker]:
        """Connect the tracker for the time of the block."""
        config, place = self.campaign.config.tracker, self.tracker_place
        driver = TRACKERS[config.driver]
        tracker = driver.make(
            Surroundings(
                open_transport=place.open_transport,
                clock=self.interruptible(place.clock),
                cancelled=self.stop_requested,
                first_number=place.first_number,
                settings=_tracker_settings(self.campaign),
                prompt=self.prompt,
                announce=self.announce,
                in_process=place.in_process,
            )
        )
        try:
            with _naming("tracker", place.url, (errors.BeamBroken,)) as name_by:
                tracker.connect()
                name_by(identity := tracker.identity())
                _check_serial("tracker", identity, config.serial)
                yield tracker
        finally:
            tracker.close()

    def interruptible(self, clock: Clock) -> Clock:
        """Return a clock whose sleep ends once a stop is requested."""
        return WakefulClock(clock, self.stop_requested)


def _first_question_number() -> int:
    """Draw the number of a session's first question."""
    # An answer to an earlier session's question may still be in the link. It carries another
    # number, and so cannot be taken for an answer of this session.
    return random.SystemRandom().randint(1, LAST_NUMBER)


@contextmanager
def connections(
    campaign: Campaign,
    stop_requested: StopRequested = never,
    alarm: Alarm = unheard,
    prompt: Prompt | None = None,
    announce: Alarm = unheard,
) -> Iterator[DeviceConnections]:
    """Yield the ways to each device; a simulated cell lives for the time of the block.

    Raise `ConfigInvalid` for two different simulated cells.
    """
    campaign.require_devices()
    connections_at = partial(DeviceConnections, campaign, stop_requested, alarm, prompt, announce)
    controller_url, tracker_url = campaign.config.controller.url, campaign.config.tracker.url
    cell_urls = {url for url in (controller_url, tracker_url) if url.startswith(SIMULATED)}
    if not cell_urls:
        yield connections_at(DevicePlace.real(controller_url), DevicePlace.real(tracker_url))
        return
    if len(cell_urls) > 1:
        raise ConfigInvalid(
            "controller and tracker are of two simulated cells: "
            f"{controller_url} and {tracker_url}",
            remedy="give both the same sim:// address",
        )
    scenario = scenario_of(campaign.folder, cell_urls.pop())
    with _in_process(campaign, scenario) as cell:

        def place(device: DeviceName, url: str) -> DevicePlace:
            is_simulated = url.startswith(SIMULATED)
            return (
                DevicePlace.simulated(cell, device, url) if is_simulated else DevicePlace.real(url)
            )

        controller, tracker = place("controller", controller_url), place("tracker", tracker_url)
        # a simulated tracker beside a real controller has to see the robot where that robot stands
        followed = None if controller.in_process else cell.cell.controller
        seen = cell if tracker.in_process else None
        yield connections_at(controller, tracker, followed, seen)


def read_by_hand(prompt: Prompt) -> Instrument:
    """Return the instrument that a person reads, asked by a prompt."""
    by_hand = InstrumentByHand(prompt)
    return lambda task: by_hand.read(task.question, len(task.columns))


def _carry(campaign: Campaign, cell: InProcessCell, reflector: str) -> None:
    """Carry the reflector of a simulated cell to an object, or with the name "" back."""
    if not reflector:
        cell.cell.carry_reflector("", None, (0.0, 0.0, 0.0), 0.0)
        return
    (carrier,) = (thing for thing in objects_of(campaign.config.objects) if thing.name == reflector)
    half: Literal[1, 2] | None = 1 if carrier.part == 1 else 2 if carrier.part == 2 else None
    place_mm, std_mm = place_of(carrier)
    cell.cell.carry_reflector(reflector, half, place_mm, min(std_mm, HOLDER_STD_MM))


def _read_instrument(campaign: Campaign, cell: InProcessCell, task: Task) -> tuple[float, ...]:
    """Read a simulated instrument, in the units of the task's columns; mark a place without any."""
    now_s = cell.now_s()
    if not task.columns:
        cell.cell.mark(now_s)
        return ()
    (of,) = (item for item in campaign.config.objects if item.name == task.object)
    shrinks = task.kind == "distance"
    item = ReadObject(
        of.name,
        of.on or "",
        of.height_mm or 0.0,
        of.place_mm or (0.0, 0.0, 0.0),
        0.01 * of.shrinkage_percent,
        0.01 * (of.shrinkage_std_percent or 0.0) if shrinks else of.std_mm or 0.0,
    )
    values = cell.cell.read_instrument(task.kind, item, task.std_mm, now_s)
    return tuple(
        math.degrees(value) if is_angle else value
        for is_angle, value in zip(KINDS[task.kind].angles, values, strict=True)
    )


@contextmanager
def connected_robot(campaign: Campaign, prompt: Prompt | None = None) -> Iterator[RobotController]:
    """Connect the controller alone for the time of the block."""
    with connections(campaign, prompt=prompt) as to, to.robot() as robot:
        yield robot


def pause_clock(campaign: Campaign) -> Clock:
    """Return the clock of pauses before a new try; event time for a simulated cell."""
    return EventClock() if campaign.is_simulated else SystemClock()


def prepare(campaign: Campaign, cell: Devices) -> None:
    """Bring tracker and robot into the state that measuring needs; the robot may move to home.

    Args:
        campaign: The campaign, whose settings name reflector and measuring time.
        cell: The cell, from `connected_cell`.

    Raises:
        DriverError: A device is not ready, as with an emergency stop, or cannot be made ready.

    Example:
        >>> with connected_cell(campaign) as cell:
        ...     prepare(campaign, cell)
    """
    tracker = campaign.config.tracker
    cell.tracker.prepare(tracker.reflector, tracker.measuring_time_s)
    cell.robot.prepare()


def require_same_mechanism(campaign: Campaign, scenario: Scenario) -> None:
    """Raise `ConfigInvalid` for a cell of another mechanism than the campaign's robot."""
    if campaign.robot.mechanism.name != scenario.robot.kind.name:
        raise ConfigInvalid(
            f"the simulated cell {scenario.name} is a {scenario.robot.kind.name}, but this "
            f"campaign's robot is a {campaign.robot.mechanism.name}",
            remedy="make a new campaign with `pkmcal new DIR --robot FILE`, whose cell is of it",
        )


class _MovedByJoints:
    """Robot whose poses no message states: it is moved to their joints.

    These follow from the parameters that its controller holds, and from the side from which the
    joints come, as a controller would compute them.
    """

    def __init__(self, robot: RobotController, campaign: Campaign) -> None:
        self._robot, self._mechanism = robot, campaign.robot.mechanism
        self._held: Mapping[str, float] | None = None
        """Parameters that the controller holds; None until they are read."""

    def move_pose(self, pose: Pose, speed_fraction: float) -> None:
        if self._held is None:
            self._held = self._robot.read_geometry()
        present = self._robot.state().joints
        joints = joints_of_pose(self._mechanism, self._held, pose, present)
        self._robot.move_joints(joints, speed_fraction)

    def write_geometry(self, geometry: Mapping[str, float]) -> None:
        self._held = None
        self._robot.write_geometry(geometry)

    def reconnect(self) -> None:
        self._held = None  # the controller may come back with other parameters
        self._robot.reconnect()

    def __getattr__(self, name: str) -> object:
        return getattr(self._robot, name)


class _FollowedRobot:
    """Real robot that passes its joints on to a simulated one whenever it stands still."""

    def __init__(self, robot: RobotController, followed: SimulatedController) -> None:
        self._robot, self._followed = robot, followed

    def state(self) -> RobotState:
        state = self._robot.state()
        if state.joints and not state.moving:
            self._followed.follow(state.joints)
        return state

    def __getattr__(self, name: str) -> object:
        return getattr(self._robot, name)  # all but the state is the real robot's


@contextmanager
def _in_process(campaign: Campaign, scenario: Scenario) -> Iterator[InProcessCell]:
    """Start a simulated cell; its state outlasts the process, in the campaign's folder."""
    # A real cell remembers between two commands: the parameters that were loaded, where the robot
    # stands, how often each target was measured. Without its memory file a cell takes the number of
    # journal records as a bound of earlier measurements, so that their noise is not drawn again.
    path = campaign.path(CELL_MEMORY)
    require_same_mechanism(campaign, scenario)
    memory = _read_memory(path, campaign.config.identity)
    before = _count_records(campaign) if memory is None else 0
    equations = partial(OwnEquations.of, campaign.robot.mechanism)
    cell = Cell(scenario, memory=memory, attempts_before=before, equations=equations)
    tracker = campaign.config.tracker
    speaks = tracker.driver if tracker.url.startswith(SIMULATED) else "emscon"
    # beside a real device the cell lives by the wall clock, else on event time
    time = EventClock if campaign.is_simulated else ScaledClock
    in_process = InProcessCell(cell, time(scenario.speed_up), tracker_speaks=speaks)
    try:
        yield in_process
    except BaseException:
        with suppress(WriteFailed):  # the first error is the one to report
            _write_memory(path, in_process, campaign.config.identity)
        raise
    _write_memory(path, in_process, campaign.config.identity)


def _count_records(campaign: Campaign) -> int:
    """Return the number of records of the journal; 0 without a journal that can be read.

    No place was measured more often than that.
    """
    try:
        with campaign.journal_reader() as journal:
            return journal.last_number()
    except (ShotsMissing, JournalFailed):  # the command that needs the journal reports it
        return 0


def _write_memory(path: Path, cell: InProcessCell, identity: str) -> None:
    """Write what a campaign's cell remembers, with the campaign's identity."""
    # an indent would make it ten times slower
    replace_text(path, json.dumps({**cell.memory(), IDENTITY: identity}))


def _read_memory(path: Path, identity: str) -> dict[str, object] | None:
    """Return what a campaign's cell remembers; None without a file.

    Raise `SimError` for a file that cannot be read, or is another campaign's.
    """
    if not bounded_files.is_there(path):
        return None
    try:
        memory = json.loads(
            bounded_files.decoded(bounded_files.read_bounded(path, MEMORY_BYTES), str(path))
        )
    except (bounded_files.FileRefused, RecursionError, ValueError) as error:
        raise SimError(f"{path}: cannot be read ({error})", remedy="delete the file") from error
    if not isinstance(memory, dict):
        raise SimError(f"{path}: holds no memory of a cell", remedy="delete the file")
    # of older versions it states no identity: they had no other test than the scenario's name
    if is_foreign(memory.pop(IDENTITY, identity), identity):
        raise SimError(
            f"{path}: is of another campaign's cell, not of identity {identity or 'none'}",
            remedy="bring this campaign's file back, or delete it to begin with a new cell",
        )
    return memory


@contextmanager
def _naming(
    device: str, url: str, kinds: tuple[type[errors.DriverError], ...]
) -> Iterator[Callable[[Identity], None]]:
    """Name a device, by its serial number and address, in every error that is about it.

    An error is about the device if it states the address or is of one of these `kinds`. Yield a
    function that takes the device's identity: from then on its serial number is named, too.
    """
    name = device

    def name_by(identity: Identity) -> None:
        nonlocal name
        name = f"{device} {identity.serial}"

    try:
        yield name_by
    except errors.DriverError as error:
        if url and url in error.problem:
            error.problem = error.problem.replace(url, f"{name} at {url}", 1)
        elif isinstance(error, kinds):
            error.problem = f"{name} at {url}: {error.problem}"
        raise


def _raw_readers(campaign: Campaign) -> RawReaders:
    """Return the readers of the raw answers of a campaign's devices."""
    controller = CONTROLLERS[campaign.config.controller.driver]
    tracker, layout = TRACKERS[campaign.config.tracker.driver], _layout(campaign)
    return RawReaders(lambda raw: controller.read_record(raw, layout), tracker.read_record)


def _tracker_settings(campaign: Campaign) -> WatchSettings | str:
    """Return settings for the tracker's driver: a file that is watched, or a serial number."""
    tracker = campaign.config.tracker
    path, watch = campaign.watched_file, tracker.watch
    if path is None:
        return tracker.serial or BY_HAND
    form = PointFormat(
        unit=watch.unit,
        columns=watch.columns.split(",") if watch.columns else None,
        coordinates=watch.coordinates,
        decimal=watch.decimal,
        option="tracker.watch.",
    )
    return WatchSettings(
        serial=tracker.serial or path.name,
        path=path,
        wait_s=watch.wait_s,
        encoding=watch.encoding,
        rows_of=point_files.data_rows,
        point_of=lambda row, text: point_files.point_of_row(row, text, path.name, form),
    )


def _hand_settings(campaign: Campaign) -> HandSettings | None:
    """Return settings of a robot that somebody moves by hand; None for any other robot."""
    if campaign.config.controller.driver != BY_HAND:
        return None
    mechanism = campaign.robot.mechanism
    # such a robot has no controller to ask: a file in the folder keeps the parameters it "holds"
    held = HeldParameters(campaign.folder, campaign.nominal)
    return HandSettings(
        serial=campaign.config.controller.serial or BY_HAND,
        in_place=tuple(campaign.config.settle.in_place_rad * a.scale for a in mechanism.joints),
        read=held.read,
        write=held.write,
        lacks=held.lacks,
        joints_of=lambda held, pose: joints_of_pose(mechanism, held, pose),
    )


def _layout(campaign: Campaign) -> RobotLayout:
    """Return the robot's joints, coordinates and parameters as robotline names them."""
    mechanism = campaign.robot.mechanism
    space = mechanism.parameters
    joints, task = (
        [Coordinate(axis.name, axis.is_revolute, axis.is_fixed) for axis in axes]
        for axes in (mechanism.joints, mechanism.task)
    )
    parameters = [(name, space[name].arm, space[name].field.stem) for name in space.names]
    # robotline has one rate of ripples for all joints
    extensions = [name for name in space.optional if name not in space.rates]
    return RobotLayout.of(joints, task, parameters, extensions)


def _check_serial(device: str, answering: Identity, expected: str | None) -> None:
    if expected is not None and answering.serial != expected:
        raise errors.WrongDevice(
            f"the {device} has serial number {answering.serial}, campaign.yaml expects {expected}",
            remedy=f"connect the right {device}, or correct {device}.serial in campaign.yaml",
        )
