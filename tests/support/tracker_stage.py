"""A simulated tracker before a reflector that a test moves and turns."""

import math

import numpy as np

from sim.faults import FaultScript
from sim.random_streams import Attempts, Purpose, WorkedTime
from sim.robot.driven_robot import SeenReflector
from sim.robot.rods import rotation
from sim.tracker.beam import Beam, Target
from sim.tracker.instrument import SimulatedTracker, TrackerState
from sim.tracker.optics import Limit, Noise, TrackerPose
from sim.tracker.section import Air, SimulatedReflector, TrackerSection

STATION = TrackerPose(np.array([2000.0, -1500.0, -200.0]), rotation(-0.04, 0.07, 2.4))
REFLECTORS = (
    SimulatedReflector(id=1, name="CCR-1.5in", surface_offset_mm=19.05),
    SimulatedReflector(id=3, name="CCR-75mm", surface_offset_mm=37.5),
)
QUIET = Noise.model_construct(coordinate_mm=0.0)
SPHERICAL = Noise(
    along=Limit(constant_um=10.0, per_metre_um=0.3),
    azimuth=Limit(constant_um=15.0, per_metre_um=6.0),
    elevation=Limit(constant_um=20.0, per_metre_um=7.0),
)
STANDING_MM = np.array([600.0, 300.0, -400.0])


class Stage:
    """A reflector that a test moves and turns."""

    def __init__(self):
        self.point_mm = np.array([0.0, 0.0, -600.0])
        self.facing = STATION.origin_in_base_mm - self.point_mm
        self.still = True
        self.target = (30_000_000, 30_000_000, 20_000_000, 20_000_000)

    def robot_reflector(self, now_s):
        return SeenReflector(self.point_mm, self.facing / np.linalg.norm(self.facing))

    def robot_is_still(self, now_s):
        return self.still

    def robot_target(self):
        return self.target


def tracker(
    stage,
    *,
    noise=QUIET,
    faults=(),
    seed=1,
    locked=True,
    worked=None,
    initialised=True,
    selected=1,
    **delivered,
):
    return SimulatedTracker(
        TrackerSection.model_construct(
            reflectors=REFLECTORS,
            noise=noise,
            air=Air(pressure_hPa=1013.0, drift_degC_per_h=0.5),
            **delivered,
        ),
        Beam(
            stage,
            lambda: STATION,
            standing_in_base_mm={Target.STANDING: STANDING_MM},
            acceptance_rad=math.radians(30.0),
            locked_on=Target.ROBOT if locked else None,
        ),
        TrackerState(is_initialised=initialised, is_warm=False, selected_reflector=selected),
        faults=FaultScript(faults, {}),
        worked=worked or WorkedTime(0.0),
        attempts=Attempts(seed, Purpose.SHOT, {}),
    )


def measured(instrument, now_s=0.0):
    end_s = instrument.begin_measurement(1.0, now_s)
    return None if end_s is None else instrument.finish_measurement(end_s)


def seen_mm(point_in_base_mm):
    return tuple(STATION.to_tracker_mm(point_in_base_mm))
