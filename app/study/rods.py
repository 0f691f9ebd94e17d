"""Imperfect parts of robots that the simulated cell draws, as parameters of the model."""

from dataclasses import replace

import numpy as np

from campaigns.arrays import Array
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.parameters import PARALLELOGRAM_SKEW, ParameterSpace
from sim.geometry import Geometry
from sim.robot.rods import Build, turned

AXIS_TILT, RAIL_TILT = "axis_tilt_deg", "rail_tilt_deg"


def vector_of_parts(level: Kinematics, geometry: Geometry, build: Build) -> Array:
    """Parameters (P,) of a robot of these rods and axes, in the base that it is built in.

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
    return p


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
