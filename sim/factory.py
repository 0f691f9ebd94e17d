"""Factory of the parts of a cell from its scenario, drawing what manufacture left to chance.

A scenario states how good a robot is; this module makes one such robot, in the units of the inside
(mm, rad, N). For each seed another robot leaves the factory, always the same one for that seed:

1. `true_geometry`: nominal parameters + stated errors + normal draws of the stated tolerances;
2. `build_of`: what the contracted parameters do not hold: each rod's own length, tilted axes,
   where the bars sit on the plate;
3. `transmission`, `behaviour`: errors of encoders and gears (sizes stated, phases drawn),
   backlash, scatter at arrival, weight and warmth;
4. `mount`, `controller_kinematics`: the reflector's place, and what the controller can compute.

Each of the draws has a stream of its own (sim/random_streams.py): a scenario that gains a tolerance
keeps all the other errors of its robots.
"""

import math
from collections.abc import Sequence

import numpy as np

from sim.geometry import (
    LENGTHS,
    Array,
    Geometry,
    Kind,
    KindParameter,
    PlateKind,
    StatedKind,
    geometry_of,
    parameter_of,
)
from sim.random_streams import Purpose, generator
from sim.robot.bars import EquationsOf, FreeMechanism, TurningPlate, free_mechanism
from sim.robot.controller import ControllerKinematics
from sim.robot.driven_robot import Behaviour, SeenReflector
from sim.robot.rods import Build, RodMechanism
from sim.robot.section import PPM, RobotSection, Tolerances
from sim.robot.tilting_kinematics import KnownPlate
from sim.robot.transmission import Load, Transmission
from sim.scenarios.schema import Scenario
from sim.tracker.optics import TrackerPose

RAD_PER_ARCMIN = math.radians(1.0 / 60.0)
RAD_PER_ARCSEC = math.radians(1.0 / 3600.0)
RAD_PER_MRAD = 1e-3
MM_PER_UM = 1e-3
MM_PER_M = 1e3
GRAVITY_N_PER_KG = 9.81


def true_geometry(robot: RobotSection, seed: int) -> dict[str, float]:
    """Draw the robot as it was really made, by flat names, mm and deg."""
    # One number is drawn for every parameter, also where its tolerance is 0: a further tolerance
    # in the scenario then leaves the other parameters of a seed as they were.
    kind, sigma = robot.kind, _sigma if isinstance(robot.kind, PlateKind) else _sigma_of_bars
    parameters, flat = dict(kind.parameters), robot.true_flat()
    if isinstance(kind, StatedKind):
        parameters |= {name: parameter_of(name) for name in kind.zeros}
    draw = generator(seed, Purpose.MANUFACTURE).standard_normal(len(parameters))
    return {
        name: flat.get(name, 0.0) + sigma(robot.tolerances, parameter) * float(normal)
        for (name, parameter), normal in zip(parameters.items(), draw, strict=True)
    }


def _sigma(tolerances: Tolerances, parameter: KindParameter) -> float:
    """Return a parameter's standard deviation of manufacture, in its unit."""
    arm, (stem, unit) = parameter
    if stem in {"x", "y", "z"} or (stem == "joint_offset" and unit == "mm"):
        # arm 0's place defines the base frame: moving it would move the frame with it
        return 0.0 if arm == 0 else tolerances.position_mm
    if stem == "joint_offset":
        return tolerances.joint_offset_deg
    if stem == "azimuth":
        return math.degrees(tolerances.azimuth_mrad * RAD_PER_MRAD)
    # where a rail points is drawn with the axes, which lean both ways; a pinion's only scales turns
    return 0.0 if stem in {"elevation", "pinion"} else tolerances.length_mm


# The places of all other arms are drawn as seen from that of arm 0, and those of the joints on the
# platform from the controlled point.
def _sigma_of_bars(tolerances: Tolerances, parameter: KindParameter) -> float:
    """Return this deviation where the platform is one body, or the mechanism one's own."""
    arm, (stem, unit) = parameter
    if stem in {"x", "y", "z"}:
        return 0.0 if arm == 0 else tolerances.position_mm
    if unit == "mm":
        is_length = stem in {*LENGTHS, "joint_offset"}
        return tolerances.length_mm if is_length else tolerances.position_mm
    if stem == "joint_offset":
        return tolerances.joint_offset_deg
    return math.degrees(tolerances.azimuth_mrad * RAD_PER_MRAD) if unit == "deg" else 0.0


def mechanism_of(
    robot: RobotSection, true_flat: dict[str, float], seed: int, equations: EquationsOf | None
) -> RodMechanism | FreeMechanism:
    """Draw the parts as they were really made; raises `SimError` without equations of its kind."""
    if not isinstance(robot.kind, PlateKind):
        return free_mechanism(robot.kind, true_flat, equations)
    truth = geometry_of(true_flat, robot.kind)
    return RodMechanism(truth, build_of(robot, truth, seed))


def build_of(robot: RobotSection, geometry: Geometry, seed: int) -> Build:
    """Draw plate, rods and axes as they were really made."""
    kind = geometry.kind
    rods = generator(seed, Purpose.RODS).standard_normal((kind.arms, 2))
    tilts = generator(seed, Purpose.TILTS).standard_normal((1 + kind.on_rails, kind.arms))
    tilts_mrad = robot.tolerances.axis_tilt_mrad * tilts
    stated_mm = np.reshape(robot.rod_errors_mm or np.zeros(2 * kind.arms), (kind.arms, 2))
    return Build(
        plate_joints_mm=robot.places_on_plate_mm(geometry),
        rod_spacing_mm=robot.rod_spacing_mm,
        rod_errors_mm=stated_mm + robot.tolerances.rod_mm * rods,
        axis_tilts_rad=(_of_arms(robot.axis_tilts_mrad, kind) + tilts_mrad[0]) * RAD_PER_MRAD,
        leans_rad=tilts_mrad[1] * RAD_PER_MRAD if kind.on_rails else None,
    )


def controller_kinematics(
    scenario: Scenario, true_flat: dict[str, float], equations: EquationsOf | None = None
) -> ControllerKinematics:
    """Return what the controller can compute beside the plain kinematics of its mechanism.

    Turns of the motors come from the drawing, so they are the true ones, and places on the plate
    are those of the drawing; errors are parameters that the controller has to be given by `load`.
    """
    robot, controller, plate, ripple_rate = scenario.robot, scenario.controller, None, None
    if controller.computes_plate_tilt and isinstance(robot.kind, PlateKind):
        joints_mm = robot.places_on_plate_mm(geometry_of(true_flat, robot.kind))
        if controller.plate_joints_mm is not None:
            joints_mm = np.array(controller.plate_joints_mm)
        plate = KnownPlate(joints_mm, robot.rod_spacing_mm, np.array(controller.reflector_mm))
    if controller.computes_transmission:
        ripple_rate = _motor_rad(robot)
    return ControllerKinematics(robot.kind, plate, ripple_rate, equations)


def _motor_rad(robot: RobotSection) -> Array:
    """Return the turn of each motor for 1 rad or mm of its joint, (n,), rad."""
    kind, gears = robot.kind, robot.transmission
    return np.where(
        kind.is_carriage, 2.0 * math.pi / np.array(gears.pitch_mm), np.array(gears.ripples_per_turn)
    )


def _of_arms(values: Sequence[float], kind: Kind) -> Array:
    """Return values by arm (n,): those given, or 0 for every arm."""
    return np.array(values) if values else np.zeros(kind.arms)


def behaviour(robot: RobotSection, seed: int) -> Behaviour:
    """Return the effects between encoders and mechanism."""
    kind, repeatability = robot.kind, robot.repeatability
    turning, shifting = _of_arms(robot.backlash_arcmin, kind), _of_arms(robot.backlash_mm, kind)
    noise = np.where(
        kind.is_carriage, repeatability.joint_mm, repeatability.joint_arcsec * RAD_PER_ARCSEC
    )
    return Behaviour(
        backlash=np.where(kind.is_carriage, shifting, turning * RAD_PER_ARCMIN),
        joint_noise=noise,
        position_noise_mm=repeatability.position_mm,
        thermal=robot.thermal,
        transmission=transmission(robot, seed),
        load=_load(robot),
    )


def transmission(robot: RobotSection, seed: int) -> Transmission:
    """Draw encoders, gears and screws as they were really made."""
    kind, gears = robot.kind, robot.transmission
    draw = generator(seed, Purpose.TRANSMISSION)
    phases = draw.uniform(-math.pi, math.pi, (2, kind.arms))
    # a ring that is e off its axis misreads angles by up to e over its radius, to first order
    eccentricity = 2.0 * gears.eccentricity_um * MM_PER_UM / gears.ring_mm
    ripple = np.where(kind.is_carriage, gears.ripple_mm, gears.ripple_arcsec * RAD_PER_ARCSEC)
    return Transmission(
        eccentricity=np.where(kind.is_carriage, 0.0, eccentricity),
        phase_rad=phases[0],
        ratio=gears.ratio_ppm * PPM * draw.standard_normal(kind.arms),
        ripple=ripple,
        ripple_phase_rad=phases[1],
        motor_rad=_motor_rad(robot),
    )


def _load(robot: RobotSection) -> Load:
    """Return the weights where they act, and the stiffness of the gears or drives below them.

    Each forearm counts with one half at its elbow and the other at the plate.
    """
    # A crank's mass is in its middle, which rises half as far as the elbow: it counts with one half
    # there. A carriage rises whole.
    weight, kind = robot.weight, robot.kind
    arm_kg = np.where(kind.is_carriage, 1.0, 0.5) * weight.arm_kg
    elbow_kg = arm_kg + 0.5 * weight.forearm_kg
    plate_kg = weight.plate_kg + weight.payload_kg + 0.5 * kind.arms * weight.forearm_kg
    stiffness = np.where(
        kind.is_carriage,
        (weight.drive_n_per_um or math.inf) / MM_PER_UM,
        (weight.gear_nm_per_arcmin or math.inf) * MM_PER_M / RAD_PER_ARCMIN,
    )
    return Load(GRAVITY_N_PER_KG * elbow_kg, GRAVITY_N_PER_KG * plate_kg, stiffness)


def mount(scenario: Scenario, station: TrackerPose) -> SeenReflector:
    """Return the mounted reflector; by default it faces the tracker from the workspace's centre."""
    robot, start = scenario.robot, TurningPlate(scenario.controller.start.pose)
    direction = robot.reflector.facing
    centre_mm = np.array(robot.workspace_centre_mm)
    facing = station.origin_in_base_mm - centre_mm if direction is None else np.array(direction)
    if direction is None and not isinstance(robot.kind, PlateKind):
        facing = facing @ start.rotation  # a platform with three turns may be turned at the start
    offset_mm = np.array(robot.reflector.offset_mm)
    return SeenReflector(offset_mm, facing / np.linalg.norm(facing), robot.reflector.half)
