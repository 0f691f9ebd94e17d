"""A scenario for another robot than it was written for, with errors of equal size.

The cell file is edited as text, so that its comments stay and the user can read what has changed:

1. geometry, joint limits, start and workspace centre become the robot's;
2. for another mechanism, named errors (`arm1.forearm_mm`) have no meaning: each group becomes a
   tolerance of its rms size, drawn by the seed; entries of each arm are dropped, and backlash gets
   its mean at every new arm;
3. sizes of cranks become sizes of carriages by the way of a typical crank's end, at 300 mm;
4. a mechanism that has no parts here states its joints and turns, for its equations come from
   outside (sim/robot/bars.py);
5. the result is parsed, so that a scenario that does not fit is refused here.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from ruamel.yaml.comments import CommentedMap, CommentedSeq

from sim.geometry import (
    CRANK_MM,
    PLACES,
    TWINS,
    Field,
    Kind,
    PlateKind,
    StatedKind,
    Unit,
    geometry_of,
)
from sim.robot.section import ENTRIES_OF_AN_ARM, RATES
from sim.scenarios.scenario import edited, parse_scenario
from sim.section import Point

MM_PER_ARCMIN = CRANK_MM * math.radians(1.0 / 60.0)
MM_PER_ARCSEC = MM_PER_ARCMIN / 60.0
SAME_ON_PLATE_MM = 1.0
"""Differences of places on the plate below which two drawings are one."""
SAME_WITHIN = {"mm": 20.0, "deg": 5.0}
"""Differences below which two sets are one robot, before and after a calibration."""


@dataclass(frozen=True)
class WantedRobot:
    """Robot for which a cell is wanted, in the units of files."""

    mechanism: str
    geometry: Mapping[str, float]
    """Parameters by flat name, mm and deg."""
    units: tuple[Unit, ...]
    """Unit of each joint."""
    joint_limits: tuple[tuple[float, float], ...]
    """Lowest and highest value of each joint."""
    centre_mm: Point
    """Place in the middle of its workspace."""
    turns_deg: Mapping[str, float]
    """Turns of its platform in the middle of its workspace, by their names."""
    zeros: tuple[str, ...]
    """Names of further parameters of a mechanism of one's own, which are 0 by its drawing."""
    reflector_mm: Point
    """Reflector from the controlled point, of a platform that is one body."""

    @cached_property
    def kind(self) -> Kind:
        """Kind of its mechanism."""
        turns, parameters = (*self.turns_deg,), (*self.geometry,)
        stated = StatedKind(self.mechanism, self.units, parameters, turns, self.zeros)
        return TWINS.get(self.mechanism, stated)


def adapted(text: str, robot: WantedRobot) -> str:
    """Adapt a cell file to a robot, unless it is of that robot; raises `ScenarioInvalid`."""
    present, kind = parse_scenario(text, "the scenario").robot, robot.kind
    if kind == present.kind and _is_same(kind, present.nominal_flat(), robot.geometry):
        return text

    def fit(tree: CommentedMap) -> None:
        section, controller = tree["robot"], tree.setdefault("controller", CommentedMap())
        section.pop("nominal", None)
        if kind != present.kind:
            _spread_errors(section, present.kind)
            _fit_arms(section, kind)
            if kind.is_carriage.any():
                _fit_drives(section, kind)
            section.insert(0, "mechanism", robot.mechanism)
        section.insert(1, "geometry", _geometry(kind, robot.geometry))
        if isinstance(kind, StatedKind):
            section.insert(1, "joints", _row(*kind.units))
            section.insert(2, "turns", _row(*kind.turns))
            section.insert(3, "zeros", _row(*kind.zeros))
        section["workspace_centre_mm"] = _row(*robot.centre_mm)
        _fit_reflector(section, robot)
        controller.pop("geometry_errors", None)
        _fit_controller(controller, robot)
        # a platform that does not turn has no rotation test, and so no limit for it
        if not kind.turns:
            tree.get("acceptance", {}).pop("rotation_mm", None)

    adapted_text = edited(text, fit)
    parse_scenario(adapted_text, f"the scenario for {robot.mechanism}")
    return adapted_text


def _fit_reflector(section: CommentedMap, robot: WantedRobot) -> None:
    """Put the reflector where the robot file has it, or where a part that turns leaves it."""
    kind, offset_mm = robot.kind, robot.reflector_mm
    if isinstance(kind, PlateKind):
        if not kind.turns_point:
            return
        # the part at the point turns with its reflector: only on its axis does it stay in place
        offset_mm = (0.0, 0.0, -45.0)
    section.setdefault("reflector", CommentedMap())["offset_mm"] = _row(*offset_mm)
    if isinstance(kind, PlateKind):
        section.yaml_add_eol_comment("the part at the point turns: on its axis", "reflector")


def _fit_controller(controller: CommentedMap, robot: WantedRobot) -> None:
    """Let the controller keep the robot's limits, and start in the middle of its workspace."""
    units, limits = {*robot.units}, {*robot.joint_limits}
    controller.pop("joint_limits", None)
    if len(units) == len(limits) == 1:
        controller[f"joint_limits_{robot.units[0]}"] = _row(*robot.joint_limits[0])
    else:
        controller["joint_limits"] = _row(*(_row(*pair) for pair in robot.joint_limits))
    start = dict(zip(("x_mm", "y_mm", "z_mm"), robot.centre_mm, strict=True))
    turned = {f"{name}_deg": turn for name, turn in robot.turns_deg.items() if turn}
    controller["start"] = CommentedMap(start | turned)
    controller["start"].fa.set_flow_style()


def with_drawing(text: str, joints_mm: Sequence[Point], reflector_mm: Point) -> str:
    """Give the controller of a cell file the places on the plate that a robot file states.

    `joints_mm` has a place for each arm. Places that the controller has already are not written.
    """
    # parameters of a loaded set are beyond the robot file's places: the controller adds them to its
    # own drawing, which must agree with the file
    scenario = parse_scenario(text, "the scenario")
    robot, present = scenario.robot, scenario.controller
    drawn_mm = present.plate_joints_mm and np.array(present.plate_joints_mm)
    if drawn_mm is None:
        assert isinstance(robot.kind, PlateKind), "others have no such places"
        geometry = geometry_of(robot.nominal_flat(), robot.kind)
        drawn_mm = robot.places_on_plate_mm(geometry)
    has_joints = np.abs(np.array(joints_mm) - drawn_mm).max() <= SAME_ON_PLATE_MM
    if has_joints and present.reflector_mm == reflector_mm:
        return text

    def fit(tree: CommentedMap) -> None:
        controller = tree.setdefault("controller", CommentedMap())
        if not has_joints:
            controller["plate_joints_mm"] = _row(*(_row(*place) for place in joints_mm))
        controller["reflector_mm"] = _row(*reflector_mm)

    return edited(text, fit)


def computing_all(text: str) -> str:
    """Let a cell file's controller compute plate tilt and gears."""

    def fit(tree: CommentedMap) -> None:
        controller = tree.setdefault("controller", CommentedMap())
        controller |= {"computes_plate_tilt": True, "computes_transmission": True}

    return edited(text, fit)


def _is_same(kind: Kind, flat: Mapping[str, float], other: Mapping[str, float]) -> bool:
    units = {name: field.unit for name, (_, field) in kind.parameters.items()}
    return all(abs(flat[name] - other[name]) <= SAME_WITHIN.get(units[name], 0.0) for name in flat)


def _geometry(kind: Kind, flat: Mapping[str, float]) -> CommentedMap:
    arms = [CommentedMap() for _ in range(kind.arms)]
    whole = CommentedMap(arms=arms)
    of_platform = whole
    if isinstance(kind, StatedKind):
        of_platform = whole["platform"] = CommentedMap()
    for name, (arm, _) in kind.parameters.items():
        holder = of_platform if arm is None else arms[arm]
        holder[name.rpartition(".")[2]] = flat[name]
    for row in arms:
        row.fa.set_flow_style()
    return whole


def _row(*values: object) -> CommentedSeq:
    row = CommentedSeq(values)
    row.fa.set_flow_style()
    return row


def _spread_errors(section: CommentedMap, kind: Kind) -> None:
    """Replace the named errors by tolerances of their size (rms)."""
    # Several stems may share a tolerance, such as arms and forearms the one of lengths: the rms is
    # over all of their values.
    errors = section.pop("errors", None)
    if not errors:
        return
    sizes: dict[str, list[float]] = {}
    for name, value in errors.items():
        sizes.setdefault(_tolerance_of(kind.parameters[name][1]), []).append(float(value))
    tolerances = section.setdefault("tolerances", CommentedMap())
    for key, values in sizes.items():
        tolerances[key] = round(math.sqrt(sum(v * v for v in values) / len(values)), 3)


def _tolerance_of(field: Field) -> str:
    if field in PLACES:
        return "position_mm"
    return field.key if field.key == "joint_offset_deg" else "length_mm"


def _fit_arms(section: CommentedMap, kind: Kind) -> None:
    """Replace the entries of each arm by a backlash of the mean size at all new arms."""
    # Errors of single rods, places on the plate and tilts of axes go: they belong to arms that the
    # new robot does not have, and tolerances of rods and axes stay. Rates become their mean.
    entries = {key: section.pop(key, None) for key in ENTRIES_OF_AN_ARM}
    if backlash := entries["backlash_arcmin"]:
        mean = sum(backlash) / len(backlash)
        sizes = {"backlash_arcmin": mean, "backlash_mm": round(mean * MM_PER_ARCMIN, 6)}
        for (key, size), here in zip(
            sizes.items(), (~kind.is_carriage, kind.is_carriage), strict=True
        ):
            if here.any():
                section[key] = _row(*(size if moves else 0.0 for moves in here))
    gears = section.get("transmission", {})
    for key in RATES:
        if isinstance(rates := gears.get(key), list):
            gears[key] = sum(rates) / len(rates)


def _fit_drives(section: CommentedMap, kind: Kind) -> None:
    """Give screws and drives of carriages the size of motors and gears.

    These and rings of encoders go where there are no cranks.
    """
    # A stiffness in N m per arc minute becomes the force at a lever of 300 mm over the way of one
    # arc minute there, N/µm; the other sizes become that way.
    gears = section.get("transmission", CommentedMap())
    has_cranks = not kind.is_carriage.all()
    taken = CommentedMap.get if has_cranks else CommentedMap.pop
    if not has_cranks:
        for key in ("eccentricity_um", "ring_mm"):
            gears.pop(key, None)
    for name, key, key_of_drives, factor in (
        ("repeatability", "joint_arcsec", "joint_mm", MM_PER_ARCSEC),
        ("transmission", "ripple_arcsec", "ripple_mm", MM_PER_ARCSEC),
        ("weight", "gear_nm_per_arcmin", "drive_n_per_um", 1.0 / MM_PER_ARCMIN / CRANK_MM),
    ):
        part = section.get(name, CommentedMap())
        if size := taken(part, key, None):
            part[key_of_drives] = round(size * factor, 6)
    if turns := taken(gears, "ripples_per_turn", None):
        gears["pitch_mm"] = round(2.0 * math.pi * CRANK_MM / turns, 6)
