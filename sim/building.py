"""Builds the parts of a cell from its scenario, drawing what manufacture left to chance."""

import math
from collections.abc import Sequence

import numpy as np

from sim.draws import Purpose, generator
from sim.faults import ANSWERS_OF, Counted, Fault
from sim.geometry import Array, Geometry, Kind, geometry_of
from sim.robot.controller import ControllerSettings
from sim.robot.driven_robot import Behaviour, Mount, Thermal
from sim.robot.rods import Build, RodMechanism, rotation
from sim.robot.tilting_kinematics import PlateDrawing
from sim.scenarios.robot import ControllerSection, RobotSection, Tolerances
from sim.scenarios.schema import FaultSection, Scenario
from sim.scenarios.tracker import LimitSection, StationSection, TrackerSection
from sim.tracker.instrument import Air, SimulatedReflector, TrackerSettings
from sim.tracker.optics import IsotropicNoise, Limit, Noise, SphericalNoise, Station

PLATE_RADIUS_MM = 45.0
"""Of a single platform's joints, where the cell file says nothing of them."""
PART_HALF_WIDTH_MM = 60.0
"""Half of the way between the two joints of a part, likewise."""
RAD_PER_ARCMIN = math.radians(1.0 / 60.0)
RAD_PER_ARCSEC = math.radians(1.0 / 3600.0)
RAD_PER_MRAD = 1e-3
PPM = 1e-6


def true_geometry(robot: RobotSection, seed: int) -> dict[str, float]:
    """The robot as it was really made, by flat names, mm and deg."""
    names = robot.kind.names
    draw = generator(seed, Purpose.MANUFACTURE).standard_normal(len(names))
    flat = robot.true_flat()
    return {
        name: flat[name] + _sigma(robot.tolerances, name) * float(draw[index])
        for index, name in enumerate(names)
    }


def _sigma(tolerances: Tolerances, name: str) -> float:
    """A parameter's standard deviation of manufacture, in the unit of its name."""
    arm, _, field = name.rpartition(".")
    if field in {"x_mm", "y_mm", "z_mm", "joint_offset_mm"}:
        return 0.0 if arm == "arm0" else tolerances.position_mm
    if field == "joint_offset_deg":
        return tolerances.joint_offset_deg
    if field == "azimuth_deg":
        return math.degrees(tolerances.azimuth_mrad * RAD_PER_MRAD)
    # where a rail points is drawn with the axes, which lean both ways; a pinion's only scales turns
    return 0.0 if field in {"elevation_deg", "pinion_mm"} else tolerances.length_mm


def rod_mechanism(robot: RobotSection, true_flat: dict[str, float], seed: int) -> RodMechanism:
    """The mechanism, with what no parameter of its contracted model describes."""
    geometry = geometry_of(true_flat, robot.kind)
    return RodMechanism(geometry, build_of(robot, geometry, seed))


def build_of(robot: RobotSection, geometry: Geometry, seed: int) -> Build:
    """Plate, rods and axes as they were really made."""
    kind = robot.kind
    rods = generator(seed, Purpose.RODS).standard_normal((kind.arms, 2))
    tilts = generator(seed, Purpose.TILTS).standard_normal((1 + kind.on_rails, kind.arms))
    tilts_mrad = robot.tolerances.axis_tilt_mrad * tilts
    told_mm = np.reshape(robot.rod_errors_mm or np.zeros(2 * kind.arms), (kind.arms, 2))
    return Build(
        plate_joints_mm=plate_joints_mm(robot, geometry),
        rod_spacing_mm=robot.rod_spacing_mm,
        rod_errors_mm=told_mm + robot.tolerances.rod_mm * rods,
        axis_tilts_rad=(_of_arms(robot.axis_tilts_mrad, kind) + tilts_mrad[0]) * RAD_PER_MRAD,
        leans_rad=tilts_mrad[1] * RAD_PER_MRAD if kind.on_rails else None,
    )


def plate_joints_mm(robot: RobotSection, geometry: Geometry) -> Array:
    """(n, 3): as told, or on either side of two parts, or around a single one."""
    if robot.plate_joints_mm is not None:
        return np.array(robot.plate_joints_mm)
    if geometry.kind.turn is None:
        return PLATE_RADIUS_MM * geometry.outward
    return np.sign(geometry.motors_mm) * [PART_HALF_WIDTH_MM, 0.0, 0.0]


def known_drawing(scenario: Scenario, true_flat: dict[str, float]) -> PlateDrawing | None:
    """What its controller knows of the plate, if it computes how the plate tilts."""
    if not scenario.controller.computes_plate_tilt:
        return None
    robot = scenario.robot
    return PlateDrawing(
        plate_joints_mm(robot, geometry_of(true_flat, robot.kind)),
        robot.rod_spacing_mm,
        np.array(robot.reflector.offset_mm),
    )


def _of_arms(values: Sequence[float], kind: Kind) -> Array:
    """(n,): as told, or 0 for every arm."""
    return np.array(values) if values else np.zeros(kind.arms)


def behaviour(robot: RobotSection) -> Behaviour:
    """Effects between encoders and mechanism: backlash, noise of arrival, growth of arms."""
    thermal, kind = robot.thermal, robot.kind
    growth = thermal.arm_ppm_per_degC * PPM * thermal.rise_degC
    told, noise = robot.backlash_arcmin, robot.repeatability.joint_arcsec * RAD_PER_ARCSEC
    if kind.on_rails:
        told, noise = robot.backlash_mm, robot.repeatability.joint_mm
    return Behaviour(
        backlash=_of_arms(told, kind) * (1.0 if kind.on_rails else RAD_PER_ARCMIN),
        joint_noise=noise,
        position_noise_mm=robot.repeatability.position_mm,
        thermal=Thermal(growth, thermal.time_constant_s),
    )


def mount(robot: RobotSection, station: Station) -> Mount:
    """The reflector, facing the tracker from the workspace's centre unless told otherwise."""
    told = robot.reflector.facing
    centre_mm = np.array(robot.workspace_centre_mm)
    facing = station.origin_in_base_mm - centre_mm if told is None else np.array(told)
    return Mount(np.array(robot.reflector.offset_mm), facing / np.linalg.norm(facing))


def controller_settings(controller: ControllerSection, kind: Kind) -> ControllerSettings:
    """Settings that the controller is delivered with."""
    on_rails = kind.on_rails
    limits = controller.joint_limits_mm if on_rails else controller.joint_limits_deg
    speed = controller.joint_speed_mm_per_s if on_rails else controller.joint_speed_deg_per_s
    step = controller.encoder_step_mm if on_rails else controller.encoder_step_deg
    return ControllerSettings(
        serial=controller.serial,
        lowest=kind.inner(limits[0]),
        highest=kind.inner(limits[1]),
        speed_per_s=kind.inner(speed),
        resolution=kind.inner(step),
        emergency_stop=controller.emergency_stop,
    )


def station_of(place: StationSection) -> Station:
    """Pose of the tracker in the base frame."""
    turns_rad = np.radians([place.roll_deg, place.pitch_deg, place.yaw_deg])
    return Station(np.array([place.x_mm, place.y_mm, place.z_mm]), rotation(*turns_rad))


def noise_of(tracker: TrackerSection) -> Noise:
    """Noise model of the tracker's shots."""
    noise = tracker.noise
    if noise.along is None or noise.azimuth is None or noise.elevation is None:
        return IsotropicNoise(noise.coordinate_mm or 0.0)
    return SphericalNoise(_limit(noise.along), _limit(noise.azimuth), _limit(noise.elevation))


def _limit(limit: LimitSection) -> Limit:
    return Limit(limit.constant_um, limit.per_metre_um)


def tracker_settings(
    tracker: TrackerSection, *, initialised: bool, warm: bool, selected: int
) -> TrackerSettings:
    """Settings that the tracker is delivered with, and the state in which it is found."""
    return TrackerSettings(
        serial=tracker.serial,
        reflectors=tuple(
            SimulatedReflector(r.id, r.name, r.target_type, r.surface_offset_mm)
            for r in tracker.reflectors
        ),
        noise=noise_of(tracker),
        air=Air(**tracker.air.model_dump()),
        initialise_s=tracker.initialise_s,
        warm_up_s=0.0 if warm else tracker.warm_up_s,
        initialised=initialised,
        selected=selected,
    )


def other_reflector_mm(tracker: TrackerSection) -> Array | None:
    """(3,): the second reflector in the base frame, if one stands there."""
    place = tracker.other_reflector_mm
    return None if place is None else np.array(place)


def fault_of(fault: FaultSection) -> Fault:
    """Fault of one entry of the fault script."""
    if fault.device is not None and fault.at_answer is not None:
        return Fault(ANSWERS_OF[fault.device], fault.at_answer, fault.kind, fault.seconds)
    if fault.at_move is not None:
        return Fault(Counted.MOVE, fault.at_move, fault.kind, fault.seconds)
    if fault.at_result is not None:
        return Fault(Counted.RESULT, fault.at_result, fault.kind, fault.seconds)
    return Fault(Counted.MEASUREMENT, fault.at_measurement or 0, fault.kind, fault.seconds)
