"""New campaigns: on real devices, or on a simulated cell of their own."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated
from uuid import uuid4

import numpy as np

from app.options import REFLECTOR_HELP, REFLECTOR_METAVAR, completer, read_place
from campaigns.errors import OptionsInvalid, OutputExists
from campaigns.files import text_file
from campaigns.kinematics.catalog import FAMILY
from campaigns.kinematics.closed_chain import ClosedChain
from campaigns.kinematics.implicit import ImplicitMechanism
from campaigns.kinematics.parameters import Role
from campaigns.planning.validation_plan import fitting_lines
from campaigns.robots.printer_config import PRINTER
from campaigns.robots.program import PYTHON, Program, trust
from campaigns.robots.robot import (
    RobotDocument,
    RobotFile,
    find_robot,
    shipped_robots,
    with_reflector,
    with_ripples_per_turn,
)
from campaigns.settings.config import CampaignConfig, new_config, write_new_campaign
from campaigns.settings.option import Option
from campaigns.settings.sections import BY_HAND, OFFLINE, SIMULATED, ValidationConfig
from campaigns.shots.printer_observations import BED, PART, SHRINKAGE_STD_PERCENT
from drivers.bounded_files import is_there
from drivers.names import CONTROLLER_NAMES, TRACKER_NAMES, driver_of_address
from drivers.texts import printable
from drivers.values import Vector3, vector
from sim.scenarios.adaptation import WantedRobot, adapted, computing_all, with_drawing
from sim.scenarios.scenario import edited, parse_scenario, scenario_text, shipped_scenarios

DEFAULT_ROBOT = "par4-prototype"
DEFAULT_SCENARIO = "paper-prototype"
OTHERS_SCENARIO = "realistic"
"""Scenario of mechanisms unlike the default robot's: the paper's errors are not typical of them.

Cranks that are 4° off use up a five-bar's margin from singularities; drawn for a Delta some are
more than 5° off, which a load refuses, and an H4 is held by its rods.
"""
COMPLETED_ROBOT, COMPLETED_SCENARIO = completer(shipped_robots), completer(shipped_scenarios)
DEFAULT_REFLECTOR = "CCR-1.5in"
SIMULATED_SPEED_PERCENT = 50.0
SCENARIO = "cell.yaml"
PLAN_BY_HAND: Mapping[str, object] = {
    "shots": 24,
    "validation_pairs": 5,
    "placement": "optimal",
    "drift_shots": 3,
}
"""Plan of 57 stops with both validations of distances: half an hour by hand, where the usual plan
takes 445. On the simulated Par4s it passes with twice to three times the usual plan's σ."""
NO_LIMITS: Mapping[str, float] = {}
NOT_SPECIFIED: Mapping[str, str | None] = {"controller": None, "tracker": None}
"""Addresses or drivers of both devices: those of the simulated cell, or those by default."""
UNATTENDED_SPEED_UP = 10_000
"""Speed-up at which a motion ends after a few questions for the controller's state."""
TrackerLimits = tuple[float, float, float, float]
LIMIT_KEYS = ("along_um", "along_um_per_m", "across_um", "across_um_per_m")
"""Keys of `tracker.uncertainty` in the order in which `new` takes the limits of a data sheet."""
LIMIT_DIGITS = 4
"""Decimals of a limit, of a tracker in µm or of a joint: more than any data sheet has."""


@dataclass(frozen=True, slots=True, kw_only=True)
class CellChoice:
    """Simulated cell of a new campaign."""

    scenario: str | None = None
    """Name of a shipped scenario, or path of a cell file; None: the usual one of such a robot."""
    seed: int | None = None
    """Seed of the cell; None: the scenario's."""
    with_limits: bool = False
    """Whether campaign.yaml gets the scenario's limits for a calibrated robot."""
    for_dry_run: bool = False
    """Whether the controller computes plate tilt and gears, and a shipped cell is not paced."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackerFacts:
    """Facts of a real tracker for campaign.yaml: its name, and the limits of its data sheet.

    Raises `OptionsInvalid` for limits without their source, and a source without limits.
    """

    name: str = ""
    """Maker and model."""
    limits: TrackerLimits | None = None
    """The limits (MPE) of the data sheet; None: the defaults."""
    data_sheet: str = ""
    typed_by: str = ""

    def __post_init__(self) -> None:
        stated = {
            "--tracker-limits": self.limits is not None,
            "--data-sheet": bool(self.data_sheet),
            "--typed-by": bool(self.typed_by),
        }
        lacking = [name for name, is_given in stated.items() if not is_given]
        if 0 < len(lacking) < len(stated):
            raise OptionsInvalid(
                f"limits of the tracker need their source: {' and '.join(lacking)} missing",
                remedy=f"give all of {', '.join(stated)}, or none",
            )

    @property
    def sections(self) -> dict[str, dict[str, object]]:
        """What campaign.yaml says of the tracker, by section; empty where nothing is stated."""
        named: dict[str, dict[str, object]] = {}
        if self.name:
            named["instruments"] = {"tracker": self.name}
        if self.limits is not None:
            limits = dict(zip(LIMIT_KEYS, self.limits, strict=True))
            source = {"data_sheet": self.data_sheet, "typed_by": self.typed_by}
            named["tracker"] = {"uncertainty": {**limits, **source}}
        return named


NO_FACTS = TrackerFacts()


def read_limits(typed: str) -> TrackerLimits:
    """Read limits such as 10,0.3,15,6, in µm and µm/m; raise `OptionsInvalid`."""
    try:
        along, along_per_m, across, across_per_m = (float(part) for part in typed.split(","))
    except ValueError:
        raise OptionsInvalid(
            f"limits of the tracker: {typed!r} is not four numbers with commas between them",
            remedy="type the limit along the beam, µm, its increase per metre, µm, and the same "
            "across it, such as A,B,C,D of ±(A + B/m) and ±(C + D/m)",
        ) from None
    return along, along_per_m, across, across_per_m


@dataclass(frozen=True, slots=True, kw_only=True)
class NewOptions:
    """Options of a new campaign: its robot, and its real or simulated devices.

    Raise `OptionsInvalid` for options that contradict each other.

    Attributes:
        robot: Name of a shipped robot, or the path of a robot file or a printer.cfg.
        scenario: The simulated cell: a shipped scenario or a cell file; None: the default.
        controller, tracker: Addresses of the devices, `tcp://HOST:PORT`; None: simulated.
        offline: Whether no device is connected.
        reflector: Measured place of the reflector from the controlled point, mm; None: the robot
            file's.
        controller_driver, tracker_driver: Protocols of the devices; None: by the address.
        tracker_name: Maker and model of a real tracker.
        tracker_limits: Limits of its data sheet, µm and µm/m; None: the defaults.
        data_sheet, typed_by: Source of these limits.
    """

    robot: Annotated[
        str,
        Option(
            "The nominal robot: a shipped one, a robot file, or a Delta printer's printer.cfg.",
            metavar="NAME",
            words=shipped_robots,
        ),
    ] = DEFAULT_ROBOT
    scenario: Annotated[
        str | None,
        Option(
            "The simulated cell: a shipped scenario, or a cell file.",
            metavar="NAME",
            default=f"{DEFAULT_SCENARIO}, or {OTHERS_SCENARIO}; none for real devices",
            words=shipped_scenarios,
        ),
    ] = None
    controller: Annotated[
        str | None,
        Option("The controller: tcp://HOST:PORT, serial:///dev/ttyUSB0?baud=115200", metavar="URL"),
    ] = None
    tracker: Annotated[str | None, Option("The tracker: tcp://HOST:700", metavar="URL")] = None
    offline: Annotated[
        bool, Option("Connect no device: write plans as tables, import measured files.")
    ] = False
    reflector: Annotated[
        Vector3 | None, Option(REFLECTOR_HELP, metavar=REFLECTOR_METAVAR, read=read_place)
    ] = None
    controller_driver: Annotated[
        str | None,
        Option(
            f"Protocol of the controller: {', '.join(CONTROLLER_NAMES)}.",
            metavar="NAME",
            words=lambda: CONTROLLER_NAMES,
        ),
    ] = None
    tracker_driver: Annotated[
        str | None,
        Option(
            f"Protocol of the tracker: {', '.join(TRACKER_NAMES)}.",
            metavar="NAME",
            words=lambda: TRACKER_NAMES,
        ),
    ] = None
    tracker_name: Annotated[
        str, Option("A real tracker's maker and model, for the certificate.", metavar="TEXT")
    ] = ""
    tracker_limits: Annotated[
        TrackerLimits | None,
        Option(
            "Limits (MPE) of its data sheet, ±(A µm + B µm/m) along the beam, ±(C + D) across.",
            metavar="A,B,C,D",
            read=read_limits,
        ),
    ] = None
    data_sheet: Annotated[str, Option("The document that states these limits.", metavar="TEXT")] = (
        ""
    )
    typed_by: Annotated[str, Option("Who took the limits from it.", metavar="NAME")] = ""

    def __post_init__(self) -> None:
        of_devices = (self.controller, self.tracker, self.controller_driver, self.tracker_driver)
        if self.offline and any((*of_devices, self.scenario)):
            raise OptionsInvalid(
                "--offline is for a campaign without devices",
                remedy="leave addresses and drivers out",
            )
        if (self.controller is None) != (self.tracker is None):
            raise OptionsInvalid(
                "--controller or --tracker is missing", remedy="give both, or neither"
            )
        if self.controller is not None and self.scenario is not None and self.rehearsed is None:
            raise OptionsInvalid(
                "--scenario is for a simulated cell, --controller for a real one", remedy="give one"
            )
        if self.controller is None and self.controller_driver is not None:
            raise OptionsInvalid(
                "--controller-driver is for a real controller: a simulated one speaks robotline",
                remedy="give --controller and --tracker too, or leave it out",
            )
        if self.tracker_facts != NO_FACTS and self.is_simulated:
            raise OptionsInvalid(
                "--tracker-name and --tracker-limits are for a real tracker: a simulated cell "
                "states its own",
                remedy="leave them out",
            )

    @property
    def tracker_facts(self) -> TrackerFacts:
        """Facts of the tracker; raise `OptionsInvalid` for limits without their source."""
        return TrackerFacts(
            name=self.tracker_name,
            limits=self.tracker_limits,
            data_sheet=self.data_sheet,
            typed_by=self.typed_by,
        )

    @property
    def urls(self) -> dict[str, str | None]:
        """Addresses of controller and tracker; None: a simulated device without an address."""
        if self.offline:
            return {"controller": OFFLINE, "tracker": OFFLINE}
        return {"controller": self.controller, "tracker": self.tracker}

    @property
    def is_simulated(self) -> bool:
        """Whether at least one device is simulated, so that a scenario states the limits."""
        return not self.offline and (self.controller is None or self.rehearsed is not None)

    @property
    def rehearsed(self) -> str | None:
        """Device that is simulated beside a real one; None: both are simulated, or neither."""
        simulated = [
            device for device, url in self.urls.items() if (url or "").startswith(SIMULATED)
        ]
        return simulated[0] if len(simulated) == 1 else None


def create_campaign(
    folder: Path, options: NewOptions, limits: Mapping[str, float] = NO_LIMITS
) -> CampaignConfig:
    """Create a campaign's folder by its options, on real devices or on a simulated cell.

    Args:
        folder: The folder; it is made if it is not there.
        options: Options of `pkmcal new`.
        limits: Acceptance limits of a real robot by their key in campaign.yaml, mm; a simulated
            robot has those of its scenario.

    Returns:
        The settings as written to campaign.yaml.

    Raises:
        ConfigInvalid: The robot, or a device's address or driver, cannot be used.
        ScenarioInvalid: The cell file cannot be used.
        OutputExists, WriteFailed: The folder has a campaign already, or cannot be written.

    Example:
        >>> create_campaign(Path("cell-7"), NewOptions(robot="delta", offline=True))
        >>> campaign = open_campaign("cell-7")
    """
    # 1. two addresses of one kind: they are taken as they are, also "offline" for both
    # 2. one of two is sim://NAME: a rehearsal, whose cell is NAME unless --scenario names another
    # 3. no address: both devices are of one simulated cell
    nominal = find_robot(options.robot)
    if options.reflector is not None:
        nominal = with_reflector(nominal, options.reflector)
    urls, simulated = options.urls, options.rehearsed
    drivers = {"controller": options.controller_driver, "tracker": options.tracker_driver}
    controller, tracker = urls.values()
    if controller is not None and tracker is not None and simulated is None:
        sections: dict[str, Mapping[str, object]] = {
            "acceptance": limits,
            **options.tracker_facts.sections,
        }
        return _create_for_devices(folder, nominal, options.urls, drivers, sections)
    named = (urls[simulated] or "").removeprefix(SIMULATED) if simulated else "cell"
    scenario = options.scenario or (None if named == "cell" else named)
    real = {device: None if device == simulated else url for device, url in urls.items()}
    cell = CellChoice(scenario=scenario, with_limits=True)
    return create_on_cell(folder, nominal, cell, real, drivers)


def trust_typed(robot: str) -> None:
    """Put a program on the user's list who typed it as `my.py:OWN`; other words change nothing.

    Raise `ConfigInvalid` for a file that cannot be read.
    """
    file, _, _ = robot.rpartition(":")
    if file.endswith(PYTHON):
        trust(Program.read(Path(file)))


def create_for_devices(
    folder: Path,
    robot: str | RobotDocument,
    controller: str,
    tracker: str,
    drivers: Mapping[str, str | None] = NOT_SPECIFIED,
    limits: Mapping[str, float] = NO_LIMITS,
) -> CampaignConfig:
    """Create a campaign on real devices; raise `ConfigInvalid`, `OutputExists` or `WriteFailed`.

    `drivers`: names for controller and tracker; None: by the address. `limits`: `acceptance`.
    """
    nominal = find_robot(robot) if isinstance(robot, str) else robot
    urls = {"controller": controller, "tracker": tracker}
    return _create_for_devices(folder, nominal, urls, drivers, {"acceptance": dict(limits)})


def _create_for_devices(
    folder: Path,
    nominal: RobotDocument,
    urls: Mapping[str, str | None],
    drivers: Mapping[str, str | None],
    sections: Mapping[str, Mapping[str, object]],
) -> CampaignConfig:
    """Create a campaign on real devices, with what `sections` of campaign.yaml state."""
    config = new_config(
        {
            **_identity(folder),
            **sections,
            "controller": _address_and_driver("controller", urls, drivers),
            "tracker": _address_and_driver("tracker", urls, drivers)
            | {"reflector": DEFAULT_REFLECTOR, **sections.get("tracker", {})},
            **({"plan": PLAN_BY_HAND} if BY_HAND in urls.values() else {}),
            **_validation(nominal.robot),
            **_objects(nominal),
        }
    )
    write_new_campaign(folder, config, nominal)
    return config


def _objects(nominal: RobotDocument) -> dict[str, object]:
    """Return the objects that a printer's firmware measures, if the robot is made of its file."""
    if not nominal.document.name.endswith(PRINTER):
        return {}
    part = {"name": PART, "shrinkage_std_percent": SHRINKAGE_STD_PERCENT}
    return {"objects": [{"name": BED}, part]}


def create_simulated(
    folder: Path, robot: str = DEFAULT_ROBOT, scenario: str | None = None, seed: int | None = None
) -> CampaignConfig:
    """Create a campaign on a simulated cell, whose scenario is kept in the folder as cell.yaml.

    Args:
        folder: The folder; it is made if it is not there.
        robot: Name of a shipped robot, or the path of a robot file.
        scenario: Name of a shipped scenario, or the path of a cell file; None: the usual one.
        seed: Seed of the cell's random errors; None: the scenario's.

    Returns:
        The settings as written to campaign.yaml.

    Raises:
        ConfigInvalid: The robot cannot be used.
        ScenarioInvalid: The cell file cannot be used.
        OutputExists, WriteFailed: The folder has a campaign already, or cannot be written.

    Example:
        >>> create_simulated(Path("rehearsed"), "delta", scenario="paper-simulation", seed=4)
    """
    return create_on_cell(folder, robot, CellChoice(scenario=scenario, seed=seed))


def create_on_cell(
    folder: Path,
    robot: str | RobotDocument,
    choice: CellChoice,
    urls: Mapping[str, str | None] = NOT_SPECIFIED,
    drivers: Mapping[str, str | None] = NOT_SPECIFIED,
) -> CampaignConfig:
    """Create a campaign on a simulated cell, perhaps with one real device beside it.

    `urls`: address of the device that is real, None for a simulated one. `drivers`: names for
    controller and tracker; None: by the address.
    Raise `ConfigInvalid`, `OutputExists`, `WriteFailed` or `ScenarioInvalid`.
    """
    # 1. the cell: the scenario, made one of the robot's mechanism and size
    nominal = find_robot(robot) if isinstance(robot, str) else robot
    is_alike = nominal.robot.mechanism.name == find_robot(DEFAULT_ROBOT).robot.mechanism.name
    usual = DEFAULT_SCENARIO if is_alike else OTHERS_SCENARIO
    scenario = choice.scenario or usual
    text = cell_text(nominal.robot, scenario, choice.seed)
    if choice.for_dry_run:
        text = computing_all(text)
        if scenario in shipped_scenarios():  # somebody's own cell keeps the pace that it states
            text = edited(text, lambda tree: tree.update(speed_up=UNATTENDED_SPEED_UP))
    cell = parse_scenario(text, scenario)
    # 2. the nominal robot: how often gears ripple in a turn is on their data sheet, how much is not
    gears = cell.robot.transmission
    if gears.ripple_arcsec and nominal.robot.mechanism.rates_are_of_turns:
        nominal = with_ripples_per_turn(nominal, gears.ripples_per_turn)
    # 3. the settings, with what an operator would have measured: where tracker and nests stand
    tracker = cell.tracker
    base = tracker.station.pose()
    places = {nest.name: base.to_tracker_mm(np.array(nest.place_mm)) for nest in tracker.nests}
    url = SIMULATED + SCENARIO.removesuffix(".yaml")
    config = new_config(
        {
            **_identity(folder),
            "controller": _address_and_driver("controller", urls, drivers, url)
            | ({} if urls["controller"] else {"speed_percent": SIMULATED_SPEED_PERCENT}),
            "tracker": {
                **_address_and_driver("tracker", urls, drivers, url),
                "reflector": tracker.reflectors[0].name,
                "place_mm": [tracker.station.x_mm, tracker.station.y_mm, tracker.station.z_mm],
                "uncertainty": _limits(tracker.noise.data_sheet),
            },
            "nests": [
                {"name": name, "place_mm": np.round(mm).tolist(), "occupied": True}
                for name, mm in places.items()
            ],
            **({"acceptance": cell.acceptance.model_dump()} if choice.with_limits else {}),
            **_validation(nominal.robot),
            **_objects(nominal),
        }
    )
    # 4. the files; campaign.yaml comes last, because it makes the folder a campaign
    text_file.refuse_existing(folder / "campaign.yaml")
    text_file.make_folder(folder)
    _write_unless_same(folder / SCENARIO, text)
    write_new_campaign(folder, config, nominal)
    return config


def cell_text(robot: RobotFile, scenario: str, seed: int | None = None) -> str:
    """Return the cell file of a scenario for a robot; raise `ScenarioInvalid`."""
    mechanism, centre = robot.mechanism, robot.workspace_centre
    limits = zip(mechanism.joints, robot.limits.of_joints(len(mechanism.joints)), strict=True)
    turns = zip(mechanism.task[3:], centre[3:].tolist(), strict=True)
    # tilts and sags of a family's plate are drawn with its rods, or, of one's own, left out
    zeros: tuple[str, ...] = ()
    reflector_mm: Vector3 = (0.0, 0.0, 0.0)
    if isinstance(mechanism, ImplicitMechanism):
        zeros = mechanism.parameters.select(Role.EXTENSION)
        reflector_mm = mechanism.reflector_mm
    wanted = WantedRobot(
        mechanism=mechanism.name,
        geometry={name: robot.parameters[name] for name in mechanism.parameters.names},
        units=tuple(axis.unit for axis in mechanism.joints),
        joint_limits=tuple(
            (round(axis.to_file(low), LIMIT_DIGITS), round(axis.to_file(high), LIMIT_DIGITS))
            for axis, (low, high) in limits
        ),
        centre_mm=vector(centre[:3]),
        zeros=zeros,
        turns_deg={axis.name: axis.to_file(turn) for axis, turn in turns},
        reflector_mm=reflector_mm,
    )
    text = adapted(scenario_text(scenario, seed), wanted)
    if mechanism.name not in FAMILY or not isinstance(mechanism, ClosedChain):
        return text
    # the drawing is of the controlled point, wherever the reflector is
    plate = mechanism.seen_from(None).plate
    assert plate is not None, "a robot file's mechanism has its plate"
    return with_drawing(text, plate.joints_mm, plate.reflector_mm or (0.0, 0.0, 0.0))


def _address_and_driver(
    device: str,
    urls: Mapping[str, str | None],
    drivers: Mapping[str, str | None],
    simulated_url: str = "",
) -> dict[str, str]:
    """Return a device's `url`, else the simulated cell's, and its `driver` for campaign.yaml.

    The driver is the one that is named, else the only one for such an address, else left out.
    """
    url = urls[device] or simulated_url
    name = drivers[device] or driver_of_address(url)
    return {"url": url} if name is None else {"url": url, "driver": name}


def _identity(folder: Path) -> dict[str, object]:
    """Return a campaign's name and a unique identity, because two folders may have one name."""
    return {"name": printable(text_file.resolved(folder).name), "identity": uuid4().hex}


def _validation(robot: RobotFile) -> dict[str, object]:
    """Return the centre of the robot's workspace, and the lengths of lines that fit into it."""
    centre, usual = robot.workspace_centre, ValidationConfig().line_lengths_mm
    lengths = fitting_lines(robot.kinematics, robot.limits, centre, usual)
    lines = {} if lengths == usual else {"line_lengths_mm": list(lengths)}
    return {"validation": {"centre_mm": centre[:3].tolist(), **lines}}


def _limits(data_sheet: Mapping[str, float]) -> dict[str, float | str]:
    """Return the simulated tracker's uncertainty; empty, for the defaults, if it has no noise."""
    if min(data_sheet["along_um"], data_sheet["across_um"]) <= 0.0:
        return {}
    limits = {name: round(limit, LIMIT_DIGITS) for name, limit in data_sheet.items()}
    return {**limits, "data_sheet": f"simulated tracker of {SCENARIO}", "typed_by": "pkmcal"}


def _write_unless_same(path: Path, text: str) -> None:
    """Write a new file, unless an earlier attempt has left the same text in it."""
    if (
        not is_there(path)
        or text_file.read_text(path, OutputExists, if_missing="try again") != text
    ):
        text_file.write_new_text(path, text)
