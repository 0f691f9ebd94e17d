"""Robots of rods for studies, drawn and moved by the simulated cell's own mechanism."""

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from campaigns.arrays import Array
from campaigns.estimation.datum import DatumSample, datum_parameters
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.parameters import PARALLELOGRAM_SKEW, ParameterSpace
from campaigns.studies.perturbations import Perturbation
from campaigns.studies.study import ForwardInTime
from sim.geometry import Geometry, Kind, geometry_of
from sim.robot.rods import COLD, Build, Growth, Plate, RodMechanism, turned
from sim.robot.section import RobotSection
from sim.robot.transmission import Transmission, heights_by_joints
from sim.tracker.optics import misread_mm

PITCHES_MM = (8.0, 40.0)
"""Pitches of screws that are drawn."""
TURNS = (15.0, 100.0)
"""Ripples in a turn of a crank that are drawn."""
WARMING = (1.5, 6.0)
"""Time constants of warming in a campaign that are drawn."""
ARCSEC = float(np.radians(1.0 / 3600.0))
AXIS_TILT, RAIL_TILT = "axis_tilt_deg", "rail_tilt_deg"


def rod_robot(
    section: RobotSection,
    sample: DatumSample,
    true: Kinematics,
    perturbation: Perturbation,
    rng: np.random.Generator,
) -> tuple[ForwardInTime, Array]:
    """Robot of a scenario's build whose parts and joints a perturbation has put out.

    Its plate is as in the robot's drawing; its parameters are those at the end, in the datum, by
    the sample, of the true robot, whose parts are perfect.
    """
    kind, plate = section.kind, true.mechanism.plate
    geometry = geometry_of_model(true, section)
    turns = 1e-3 * perturbation.azimuths_mrad * rng.standard_normal(kind.arms)
    turns -= turns.mean()  # a turn of all arms is the frame's and the mounts'
    geometry = replace(geometry, azimuths_rad=geometry.azimuths_rad + turns)
    rods_mm = perturbation.rods_mm * rng.standard_normal((kind.arms, 2))
    axes_rad = 1e-3 * perturbation.axes_mrad * rng.standard_normal((1 + kind.on_rails, kind.arms))
    build = Build(
        plate_joints_mm=np.array(plate.joints_mm),
        rod_spacing_mm=section.rod_spacing_mm,
        rod_errors_mm=rods_mm,
        axis_tilts_rad=axes_rad[0],
        leans_rad=axes_rad[1] if kind.on_rails else None,
    )
    rods, offset = RodMechanism(geometry, build), np.array(plate.reflector_mm)
    gears = drawn_transmission(perturbation, true, kind, rng)
    grown, rate = drawn_growth(perturbation, rng)

    def plates(joints: Array, guesses: Iterable[Plate], passed: Array | float = 0.0) -> list[Plate]:
        warm = np.expm1(-rate * np.broadcast_to(passed, len(joints))) / np.expm1(-rate)
        growths = (Growth(*row) for row in np.outer(warm, grown).tolist())
        rows = zip(joints, guesses, growths, strict=True)
        return [rods.settle(*row)[0] for row in rows]

    def forward(encoders: Array, passed: Array | float) -> Array:
        joints = gears.joints(encoders)
        near = true.forward(joints).values_or_raise()
        level = (Plate.level(kind, pose[:3], float(pose[3:].sum())) for pose in near)
        settled = plates(joints, level, passed)
        if perturbation.sag_mm:
            states = zip(joints, settled, strict=True)
            rises = np.array([heights_by_joints(rods, row, at)[1] for row, at in states])
            yielding = perturbation.sag_mm / np.ptp(np.sum(rises**2, axis=1))
            settled = plates(joints - yielding * rises, settled)
        return np.array([rods.reflector_mm(each, offset) for each in settled])

    cold = Kinematics(true.mechanism, vector_of_parts(true, geometry, build, gears))
    space, ppm = true.mechanism.parameters, (1e6 * np.array(grown)).tolist()
    grown_by = dict(zip(space.thermal, ppm, strict=True))
    warm = Kinematics(true.mechanism, true.mechanism.grown(cold.parameters, grown_by).vector)
    return forward, datum_parameters(true, warm, sample).p


def drawn_growth(perturbation: Perturbation, rng: np.random.Generator) -> tuple[Growth, float]:
    """Growth over the campaign, forearms' and frame's a part of the arms', and how fast it is."""
    if not perturbation.warmth_ppm:
        return COLD, WARMING[0]
    parts = 1e-6 * perturbation.warmth_ppm * np.array([1.0, *rng.uniform(size=2)])
    return Growth(*parts), float(rng.uniform(*WARMING))


def misread(points_mm: Array, perturbation: Perturbation) -> Array:
    """Points as a faulty tracker reads them, in its frame, (N, 3)."""
    return misread_mm(points_mm, perturbation.reflector_mm, 1e-3 * perturbation.transit_mrad)


def drawn_transmission(
    perturbation: Perturbation, true: Kinematics, kind: Kind, rng: np.random.Generator
) -> Transmission:
    """Gears, encoders and screws of a perturbation, with the drives' rate that the robot states."""
    one = np.eye(kind.arms)[int(rng.integers(kind.arms))]
    phases = rng.uniform(-np.pi, np.pi, kind.arms)
    ripple = perturbation.period_mm if kind.on_rails else ARCSEC * perturbation.ripple_arcsec
    drawn = rng.uniform(*(PITCHES_MM if kind.on_rails else TURNS))
    rate = 2.0 * np.pi / drawn if kind.on_rails else drawn
    return Transmission(
        eccentricity=np.full(kind.arms, np.radians(perturbation.eccentric_deg)),
        phase_rad=phases,
        ratio=1e-6 * perturbation.ratio_ppm * one,
        ripple=np.full(kind.arms, ripple),
        ripple_phase_rad=phases,
        motor_rad=true.mechanism.transmission.ripple_rate or float(rate),
    )


def geometry_of_model(model: Kinematics, section: RobotSection) -> Geometry:
    """The simulator's geometry of a robot with perfect parts."""
    known = model.parameters
    return geometry_of({name: known[name] for name in section.kind.names}, section.kind)


def vector_of_parts(
    level: Kinematics, geometry: Geometry, build: Build, gears: Transmission | None = None
) -> Array:
    """Parameters (P,) of a robot of these rods, axes and gears, in the base that it is built in.

    A skew is the difference of a forearm's rods over their distance, the forearm their mean.
    """
    space, p = level.mechanism.parameters, level.p.copy()
    p[space.places(space.of_field("azimuth_deg"))] = geometry.azimuths_rad
    p[space.places(space.of_field("forearm_mm"))] += build.rod_errors_mm.mean(axis=1)
    apart_mm = build.rod_errors_mm[:, 1] - build.rod_errors_mm[:, 0]
    p[space.places(space.of_field("parallelogram_skew_deg"))] += apart_mm / build.rod_spacing_mm
    p[space.places(space.of_field(AXIS_TILT))] += build.axis_tilts_rad
    if geometry.kind.on_rails:
        leaning = geometry.rails
        if build.leans_rad is not None:
            leaning = turned(leaning, geometry.sideways, build.leans_rad)
        rails = turned(leaning, geometry.outward, build.axis_tilts_rad)
        azimuths = geometry.azimuths_rad
        outward = rails[:, 0] * np.cos(azimuths) + rails[:, 1] * np.sin(azimuths)
        aside = rails[:, 1] * np.cos(azimuths) - rails[:, 0] * np.sin(azimuths)
        p[space.places(space.of_field("elevation_deg"))] = np.arctan2(rails[:, 2], outward)
        p[space.places(space.of_field(RAIL_TILT))] = np.arcsin(aside)
    for name, values in ({} if gears is None else terms_of(gears)).items():
        if own := [each.name for each in space if each.field.stem == name]:
            p[space.places(own)] = values
    return p


def terms_of(gears: Transmission) -> dict[str, Array]:
    """Values (n,) of the transmission's parameters that stand for gears, by their stems.

    What an eccentric scale adds twice a turn, by its eccentricity squared, is left out.
    """
    return {
        "encoder_gain": gears.ratio,
        "eccentricity_sin": gears.eccentricity * np.cos(gears.phase_rad),
        "eccentricity_cos": -gears.eccentricity * np.sin(gears.phase_rad),
        "ripple_sin": gears.ripple * np.cos(gears.ripple_phase_rad),
        "ripple_cos": -gears.ripple * np.sin(gears.ripple_phase_rad),
    }


def told_by(build: Build, space: ParameterSpace, free: tuple[str, ...]) -> Build:
    """Build without what no free parameter describes."""
    has_skews = bool({*free} & {*space.of_field(PARALLELOGRAM_SKEW.name)})
    has_tilts = bool({*free} & {*space.of_field(AXIS_TILT, RAIL_TILT)})
    leans = build.leans_rad
    return replace(
        build,
        rod_errors_mm=build.rod_errors_mm * has_skews,
        axis_tilts_rad=build.axis_tilts_rad * has_tilts,
        leans_rad=None if leans is None else leans * has_tilts,
    )
