"""Instruments that a person reads in a simulated cell: a bed and a touch probe, callipers, a probe.

Each object has its own truth, drawn once by the cell's seed and the object's name: the slopes of a
bed, the height of a block beside its stated one, the shrinkage of a printed part, where a probe
sits on the tool. A reading is that truth at the place of the robot's true tool, with noise of the
σ that the observation states, drawn by object, place and attempt. The equations are of solid
geometry, and none is shared with the estimator's: the distance of a point from a plane by its
normal, the length between two points, and a probe's pose as a product of rotation matrices, whose
rotation vector comes from a quaternion.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sim.errors import SimError
from sim.geometry import UP, Array
from sim.random_streams import Attempts, Purpose, generator
from sim.robot.rods import turned
from sim.tracker.optics import TrackerPose

SLOPE_STD = 2e-3
"""Standard deviation of a bed's slopes."""
BELOW_MM = 300.0
"""Distance of a bed below the origin of heights, the workspace's centre."""
PROBE_TURN_STD_RAD = 0.02
TURN_LEVER_MM = 100.0
"""Distance at which σ of a turn is stated as one of a point."""


@dataclass(frozen=True, slots=True)
class ReadObject:
    """Object of an observation, as the operator knows it."""

    name: str
    on: str = ""
    """Object that it stands on."""
    height_mm: float = 0.0
    place_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Place of a probe on the tool."""
    shrinkage: float = 0.0
    std: float = 0.0
    """1 σ of its height or place, mm, or of its shrinkage."""


@dataclass(frozen=True, slots=True)
class Reading:
    """Values of an instrument in mm and rad, and the true ones."""

    values: tuple[float, ...]
    true: tuple[float, ...]


@dataclass(frozen=True, slots=True, eq=False)
class Instruments:
    """Instruments of one cell."""

    seed: int
    centre_mm: Array
    """Centre of the workspace, (3,)."""
    station: TrackerPose
    attempts: Attempts
    """Draws of readings."""

    def read(
        self, kind: str, item: ReadObject, std_mm: float, tools: Sequence[tuple[Array, Array]]
    ) -> Reading:
        """Return the reading at one or two poses of the tool: its point (3,) and its axes (3, 3).

        Raise `SimError` for a kind of which there is no instrument.
        """
        points, (point, axes) = [point for point, _ in tools], tools[-1]
        if kind == "height":
            true = [self._height_mm(item.name, point)]
        elif kind == "block":
            height_mm = item.height_mm + item.std * float(self._draws(item.name, 1)[0])
            true = [self._height_mm(item.on, point) - height_mm]
        elif kind == "distance":
            shrunk = item.shrinkage + item.std * float(self._draws(item.name, 1)[0])
            true = [float(np.linalg.norm(points[1] - points[0])) * (1.0 - shrunk)]
        elif kind == "probe":
            true = self._probe(item, point, axes)
        else:
            raise SimError(
                f"the simulated cell has no instrument for the kind '{kind}'",
                remedy="practise on heights, blocks, distances and probes",
            )
        scale = [std_mm] * min(len(true), 3) + [std_mm / TURN_LEVER_MM] * (len(true) - 3)
        key = tuple(round(1e3 * float(value)) for value in np.concatenate(points))
        draw = self.attempts.next_generator((*item.name.encode(), *key))
        noise = np.array(scale) * draw.standard_normal(len(true))
        return Reading(tuple((np.array(true) + noise).tolist()), tuple(true))

    def _draws(self, name: str, count: int) -> Array:
        """Return the standard normal draws (count,) of an object's manufacture."""
        return generator(self.seed, Purpose.OBJECT, *name.encode()).standard_normal(count)

    def _height_mm(self, bed: str, point_mm: Array) -> float:
        """Return the distance of a point from a bed along the bed's normal."""
        slopes = SLOPE_STD * self._draws(bed, 2)
        tilt = math.hypot(*slopes)
        axis = np.array([[slopes[1], -slopes[0], 0.0]]) / max(tilt, 1e-12)
        (normal,) = turned(UP[None], axis, np.array([math.atan(tilt)]))
        return float(normal @ (point_mm - self.centre_mm + BELOW_MM * UP))

    def _probe(self, item: ReadObject, point_mm: Array, axes: Array) -> list[float]:
        """Return the pose of a probe in the tracker's frame: x, y, z and a rotation vector."""
        draws = self._draws(item.name, 6)
        place_mm = np.array(item.place_mm) + item.std * draws[:3]
        turn_rad = PROBE_TURN_STD_RAD * draws[3:]
        angle = float(np.linalg.norm(turn_rad))
        columns = turned(np.eye(3), np.tile(turn_rad / angle, (3, 1)), np.full(3, angle))
        on_tool = columns.T  # the images of x, y, z are the columns of the rotation
        in_tracker = self.station.base_from_tracker.T @ axes @ on_tool
        seen_mm = self.station.to_tracker_mm(point_mm + axes @ place_mm)
        return [*seen_mm.tolist(), *rotation_vector_rad(in_tracker).tolist()]


def rotation_vector_rad(matrix: Array) -> Array:
    """Return the rotation vector (3,) of a rotation (3, 3), of an angle up to π."""
    # The quaternion (s, v) of a rotation R is an eigenvector, of the eigenvalue 1, of the symmetric
    # matrix K of Bar-Itzhack (2000): no case has to be distinguished near π.
    m = matrix
    k = np.array([
        [m[0, 0] - m[1, 1] - m[2, 2], m[1, 0] + m[0, 1], m[2, 0] + m[0, 2], m[2, 1] - m[1, 2]],
        [m[1, 0] + m[0, 1], m[1, 1] - m[0, 0] - m[2, 2], m[2, 1] + m[1, 2], m[0, 2] - m[2, 0]],
        [m[2, 0] + m[0, 2], m[2, 1] + m[1, 2], m[2, 2] - m[0, 0] - m[1, 1], m[1, 0] - m[0, 1]],
        [m[2, 1] - m[1, 2], m[0, 2] - m[2, 0], m[1, 0] - m[0, 1], m[0, 0] + m[1, 1] + m[2, 2]],
    ])  # fmt: skip
    *vector, scalar = np.linalg.eigh(k / 3.0)[1][:, -1] * 1.0
    if scalar < 0.0:
        vector, scalar = [-v for v in vector], -scalar
    length = float(np.linalg.norm(vector))
    angle = 2.0 * math.atan2(length, scalar)
    return np.array(vector) * (angle / length if length > 0.0 else 0.0)
