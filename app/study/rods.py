"""Robots of rods for studies, drawn and moved by the simulated cell's own mechanism."""

from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.studies.affected import Forward
from campaigns.studies.effects import Effect
from sim.building import plate_joints_mm
from sim.geometry import geometry_of
from sim.robot.rods import Build, Plate, RodMechanism
from sim.scenarios.robot import RobotSection


@dataclass(frozen=True, slots=True)
class RodRobots:
    """Robots of a scenario's build whose rods and axes an effect has put out."""

    section: RobotSection

    def __call__(self, true: Kinematics, effect: Effect, rng: np.random.Generator) -> Forward:
        """Forward model of one, from joints (N, n) to points (N, 3)."""
        flat, section, kind = true.flat(), self.section, self.section.kind
        geometry = geometry_of({name: flat[name] for name in kind.names}, kind)
        build = Build(
            plate_joints_mm=plate_joints_mm(section, geometry),
            rod_spacing_mm=section.rod_spacing_mm,
            rod_errors_mm=effect.rods_mm * rng.standard_normal((kind.arms, 2)),
            axis_tilts_rad=1e-3 * effect.axes_mrad * rng.standard_normal(kind.arms),
        )
        rods = RodMechanism(geometry, build)
        offset = np.array(section.reflector.offset_mm)

        def forward(joints: Array) -> Array:
            near, points = true.forward(joints).values_or_raise(), []
            for row, pose in zip(joints, near, strict=True):
                guess = Plate.level(kind, pose[:3], float(pose[3:].sum()))
                plate = rods.settle(row, 0.0, guess)[0]
                points.append(rods.reflector_mm(plate, offset))
            return np.array(points)

        return forward
