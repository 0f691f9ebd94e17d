"""A scenario for another robot than it was written for: its errors as large, its cell the same.

Named errors of one robot mean nothing to another: they become tolerances of the same size, drawn by
the seed. What is told of cranks' angles is told of carriages by the way of a typical crank's end.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from ruamel.yaml.comments import CommentedMap, CommentedSeq

from sim.errors import ScenarioInvalid
from sim.geometry import CRANK_MM, KINDS, PLACES, Field, Kind
from sim.robot.section import ENTRIES_OF_AN_ARM
from sim.scenarios.scenario import edited, parse_scenario
from sim.section import Point

ARCMIN = math.radians(1.0 / 60.0)
ARCSEC = math.radians(1.0 / 3600.0)
SAME_WITHIN = {"mm": 20.0, "deg": 5.0}
"""Robots nearer than that are one, before and after a calibration."""
REFLECTOR_HEIGHT_MM = -45.0
DIGITS = 6


@dataclass(frozen=True, slots=True)
class OtherRobot:
    """Robot for which a cell is wanted, in mm and deg."""

    mechanism: str
    geometry: Mapping[str, float]
    """By flat name."""
    joint_limits: tuple[float, float]
    """In the unit of its joints."""
    centre_mm: Point

    @property
    def kind(self) -> Kind:
        """Parts of which it is built."""
        return KINDS[self.mechanism]


def adapted(text: str, robot: OtherRobot) -> str:
    """Adapt a cell file to a robot, unless it is of that robot; raises `ScenarioInvalid`."""
    if robot.mechanism not in KINDS:
        raise ScenarioInvalid(
            f"no simulated cell has a robot of the kind {robot.mechanism}",
            remedy="give --controller and --tracker, or --offline",
        )
    scenario = parse_scenario(text, "the scenario")
    same_kind = scenario.robot.kind is robot.kind
    if same_kind and _is_same(robot.kind, scenario.robot.nominal_flat(), robot.geometry):
        return text

    def fit(tree: CommentedMap) -> None:
        _fit_robot(tree["robot"], robot, scenario.robot.kind)
        _fit_controller(tree, robot)
        if robot.kind.turn is None:
            tree.get("acceptance", {}).pop("rotation_mm", None)

    return _checked(edited(text, fit), f"the scenario for {robot.mechanism}")


def computing_all(text: str) -> str:
    """Let a cell file's controller compute plate tilt and gears; raises `ScenarioInvalid`."""

    def tell(tree: CommentedMap) -> None:
        controller = tree.setdefault("controller", CommentedMap())
        controller |= {"computes_plate_tilt": True, "computes_transmission": True}

    return _checked(edited(text, tell), "the scenario whose controller computes all")


def _checked(text: str, name: str) -> str:
    parse_scenario(text, name)
    return text


def _fit_robot(section: CommentedMap, robot: OtherRobot, before: Kind) -> None:
    """Set another geometry, and errors as large as those of the one before."""
    section.pop("nominal", None)
    if before is not robot.kind:
        _spread_errors(section, before)
        _fit_arms(section, robot.kind)
        section.insert(0, "mechanism", robot.mechanism)
    section.insert(1, "geometry", _geometry(robot))
    section["workspace_centre_mm"] = _row(list(robot.centre_mm))
    if robot.kind.turns_point:
        section.setdefault("reflector", {})["offset_mm"] = _row([0.0, 0.0, REFLECTOR_HEIGHT_MM])
        section.yaml_add_eol_comment("the part at the point turns: on its axis", "reflector")


def _is_same(kind: Kind, flat: Mapping[str, float], other: Mapping[str, float]) -> bool:
    within = {name: SAME_WITHIN[field.unit] for name, (_, field) in kind.parameters.items()}
    return all(abs(flat[name] - other[name]) <= within[name] for name in flat)


def _geometry(robot: OtherRobot) -> CommentedMap:
    arms = [CommentedMap() for _ in range(robot.kind.arms)]
    whole = CommentedMap(arms=arms)
    for name, (arm, field) in robot.kind.parameters.items():
        holder = whole if arm is None else arms[arm]
        holder[field.key] = robot.geometry[name]
    for each in arms:
        each.fa.set_flow_style()
    return whole


def _row(values: list[float]) -> CommentedSeq:
    row = CommentedSeq(values)
    row.fa.set_flow_style()
    return row


def _spread_errors(section: CommentedMap, kind: Kind) -> None:
    """Return the tolerances of the size (rms) of the errors that are named."""
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
    """Convert the entries of each joint to as many joints, in their unit."""
    told = {key: section.pop(key, None) for key in ENTRIES_OF_AN_ARM}
    if backlash := told["backlash_arcmin"]:
        size = sum(backlash) / len(backlash)
        key = "backlash_mm" if kind.on_rails else "backlash_arcmin"
        size = round(size * ARCMIN * CRANK_MM, DIGITS) if kind.on_rails else size
        section[key] = _row([size] * kind.arms)
    if kind.on_rails:
        _fit_drives(section)
    repeatability = section.get("repeatability", {})
    if kind.on_rails and (noise := repeatability.pop("joint_arcsec", None)):
        repeatability["joint_mm"] = round(noise * ARCSEC * CRANK_MM, DIGITS)


def _fit_drives(section: CommentedMap) -> None:
    """Replace motors and gears by screws and drives of carriages; rings of encoders go."""
    told, weight = section.get("transmission", {}), section.get("weight", {})
    for key in ("eccentricity_um", "ring_mm"):
        told.pop(key, None)
    if ripple := told.pop("ripple_arcsec", None):
        told["ripple_mm"] = round(ripple * ARCSEC * CRANK_MM, DIGITS)
    if turns := told.pop("ripples_per_turn", None):
        told["pitch_mm"] = round(2.0 * math.pi * CRANK_MM / turns, DIGITS)
    if stiffness := weight.pop("gear_nm_per_arcmin", None):
        weight["drive_n_per_um"] = round(stiffness / ARCMIN / CRANK_MM**2, DIGITS)


def _fit_controller(tree: CommentedMap, robot: OtherRobot) -> None:
    """Set limits and start of the robot."""
    controller = tree.setdefault("controller", CommentedMap())
    controller.pop("geometry_errors", None)
    controller[f"joint_limits_{robot.kind.unit}"] = _row(list(robot.joint_limits))
    start = CommentedMap(zip(("x_mm", "y_mm", "z_mm"), robot.centre_mm, strict=True))
    start.fa.set_flow_style()
    controller["start"] = start
