"""Robots of eight rods for studies, drawn and moved by the simulated cell's own mechanism."""

from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.studies.affected import Forward
from campaigns.studies.effects import Effect
from sim.geometry import FLAT_NAMES, geometry_of
from sim.robot.rods import Build, EightRods, Plate
from sim.scenarios.robot import RobotSection


@dataclass(frozen=True, slots=True)
class EightRodRobots:
    """Robots of a scenario's build whose rods and axes an effect has put out."""

    section: RobotSection

    def __call__(self, true: Kinematics, effect: Effect, rng: np.random.Generator) -> Forward:
        """Forward model of one, from joints (N, 4) to points (N, 3)."""
        flat, section = true.flat(), self.section
        build = Build(
            plate_joints_mm=np.array(section.plate_joints_mm),
            rod_spacing_mm=section.rod_spacing_mm,
            rod_errors_mm=effect.rods_mm * rng.standard_normal((4, 2)),
            axis_tilts_rad=1e-3 * effect.axes_mrad * rng.standard_normal(4),
        )
        rods = EightRods(geometry_of({name: flat[name] for name in FLAT_NAMES}), build)
        offset = np.array(section.reflector.offset_mm)

        def forward(joints: Array) -> Array:
            near, points = true.forward(joints).values_or_raise(), []
            for row, pose in zip(joints, near, strict=True):
                guess = Plate(np.array([*pose[:3], 0.0, 0.0, 0.0, pose[3]]))
                plate = rods.settle(row, 0.0, guess)[0]
                points.append(plate.position_mm + plate.rotation @ offset)
            return np.array(points)

        return forward
