"""What shots tell, by how they are placed, and what planning costs: the table of docs/model.md.

python -m benchmarks.planning [--repeats N] [--json]

σ of the worst length and angle, and the predicted error of position over the workspace in the frame
that the same shots gave, for a tracker with 0.015/√3 mm per coordinate; medians over draws.
Planning is given in seconds of one core. Exit code 1 when a figure misses its limit.
"""

import argparse
import json
import math
import os
import sys
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields

os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1")
# before NumPy is imported: the limit is for one core, and the program itself keeps to one

import numpy as np

from campaigns.arrays import Array, Index
from campaigns.design.criteria import CriterionName
from campaigns.design.pose_sampling import (
    FeasibleRegion,
    boundary_poses,
    interior_poses,
    random_pairs,
)
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.information import (
    point_jacobian,
    position_std_mm,
    predict_distances,
    predict_points,
)
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.par4 import PAR4
from campaigns.planning.optimal_plan import OptimalRequest, choose_measurements, draw_candidates
from campaigns.planning.plans import PlanRequest
from campaigns.robots.robot import find_robot, pose_row
from drivers.values import Pose

CENTRE = Pose(0.0, 0.0, -575.0, 0.0)
NOISE_MM = 0.015 / math.sqrt(3.0)
ISOTROPIC = TrackerUncertainty(NOISE_MM, 0.0, NOISE_MM, 0.0)
RANDOM_DRAWS = 21
WORKSPACE_SAMPLE = 2000
FREE = PAR4.parameters.free_by_default
ANGLE = PAR4.parameters.is_angle[PAR4.parameters.places(FREE)]


@dataclass(frozen=True)
class Row:
    """A line of the table; without a criterion poses are drawn by `place`."""

    shots: int
    estimator: Estimator
    place: str
    criterion: CriterionName | None = None

    def name(self) -> str:
        return f"{self.shots} shots, {self.estimator}, {self.place}"


PLACES = {"random": interior_poses, "near the limits": boundary_poses}
HEADLINE = Row(120, Estimator.POINTS, "I-optimal", "I")
FORTY = Row(40, Estimator.POINTS, "I-optimal", "I")
FOURTEEN = Row(14, Estimator.POINTS, "I-optimal", "I")
ROWS = (
    Row(120, Estimator.DISTANCES, "random"),
    Row(120, Estimator.DISTANCES, "near the limits"),
    Row(120, Estimator.DISTANCES, "I-optimal", "I"),
    Row(120, Estimator.POINTS, "random"),
    Row(120, Estimator.POINTS, "near the limits"),
    Row(120, Estimator.POINTS, "D-optimal", "D"),
    HEADLINE,
    FORTY,
    FOURTEEN,
)


@dataclass(frozen=True)
class Figures:
    """Errors of position are NaN where the shots give no frame, times where nothing is planned."""

    worst_length_mm: float
    worst_angle_deg: float
    mean_position_um: float = math.nan
    max_position_um: float = math.nan
    planning_s: float = math.nan


LIMITS = {
    HEADLINE: {
        "worst_length_mm": 0.0135,
        "worst_angle_deg": 0.0012,
        "mean_position_um": 3.3,
        "planning_s": 3.0,
    },
    FORTY: {"worst_length_mm": 0.024},
    FOURTEEN: {"worst_length_mm": 0.06},
}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--repeats", type=int, default=3, help="of each optimal plan")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    region = prototype_region()
    table = {row: measured(region, row, asked.repeats) for row in ROWS}
    missed = list(misses(table))
    if asked.json:
        print(json.dumps({"rows": [document(*line) for line in table.items()], "missed": missed}))
    else:
        show(table)
        for line in missed:
            print(line)
    return 1 if missed else 0


def prototype_region() -> FeasibleRegion:
    """All that the robot reaches, its reflector seen from everywhere."""
    robot = find_robot("par4-prototype").robot
    centre, tracker = pose_row(CENTRE), np.array([2500.0, 0.0, -575.0])
    geometry, limits = robot.kinematics, robot.limits
    return FeasibleRegion(geometry, limits, centre, tracker, np.array([1.0, 0.0, 0.0]), np.pi)


def measured(region: FeasibleRegion, row: Row, repeats: int) -> Figures:
    """Medians over draws."""
    seeds = range(repeats if row.criterion else RANDOM_DRAWS)
    draws = [one_draw(region, row, np.random.default_rng(seed)) for seed in seeds]
    medians = (np.median([getattr(draw, f.name) for draw in draws]) for f in fields(Figures))
    return Figures(*(float(median) for median in medians))


def one_draw(region: FeasibleRegion, row: Row, rng: np.random.Generator) -> Figures:
    began_s = time.process_time()
    poses, pairs = placed(region, row, rng)
    planning_s = time.process_time() - began_s if row.criterion else math.nan
    joints = region.kinematics.inverse(poses).values_or_raise()
    if row.estimator == Estimator.DISTANCES:
        return by_distances(region.kinematics, joints, poses, pairs, planning_s)
    workspace = interior_poses(region, WORKSPACE_SAMPLE, rng)
    return by_points(region.kinematics, joints, poses, workspace, planning_s)


def placed(region: FeasibleRegion, row: Row, rng: np.random.Generator) -> tuple[Array, Index]:
    """Poses (N, 4) and pairs of them (N/2, 2)."""
    if row.criterion is None:
        poses = PLACES[row.place](region, row.shots, rng)
        return poses, random_pairs(poses, rng)
    plan = PlanRequest(row.shots, 0, 2, CENTRE)
    request = OptimalRequest(
        plan=plan,
        uncertainty=ISOTROPIC,
        free=FREE,
        estimator=row.estimator,
        criterion=row.criterion,
    )
    options = draw_candidates(region, request, rng)
    chosen = choose_measurements(options, request, rng)
    return options.poses[options.ends[chosen].ravel()], np.arange(row.shots).reshape(-1, 2)


def by_distances(
    geometry: Kinematics, joints: Array, poses: Array, pairs: Index, planning_s: float
) -> Figures:
    variance = np.full(len(pairs), 2.0 * NOISE_MM**2)
    std = predict_distances(geometry, FREE, joints, poses, pairs, variance).std
    return Figures(*worst(std), planning_s=planning_s)


def by_points(
    geometry: Kinematics, joints: Array, poses: Array, workspace: Array, planning_s: float
) -> Figures:
    noise = np.broadcast_to(NOISE_MM**2 * np.eye(3), (len(poses), 3, 3))
    known = predict_points(geometry, FREE, joints, poses, noise).with_frame
    there = geometry.inverse(workspace).values_or_raise()
    rows = point_jacobian(geometry, FREE, there, workspace)
    error_um = 1e3 * position_std_mm(rows, known)
    std = np.sqrt(np.diag(known))[: len(ANGLE)]
    return Figures(*worst(std), float(error_um.mean()), float(error_um.max()), planning_s)


def worst(std: Array) -> tuple[float, float]:
    """Length in mm, angle in degrees."""
    return float(std[~ANGLE].max()), float(np.degrees(std[ANGLE].max()))


def misses(table: dict[Row, Figures]) -> Iterator[str]:
    for row, limits in LIMITS.items():
        for figure, limit in limits.items():
            value = getattr(table[row], figure)
            if not value <= limit:
                yield f"{row.name()}: {figure} is {value:.4g}, limit {limit:g}"


def document(row: Row, figures: Figures) -> dict[str, str | int | float | None]:
    known = {name: None if math.isnan(v) else v for name, v in asdict(figures).items()}
    return {"shots": row.shots, "estimator": row.estimator, "place": row.place, **known}


def show(table: dict[Row, Figures]) -> None:
    print(f"{'':40}{'length mm':>10}{'angle °':>10}{'mean µm':>9}{'max µm':>8}{'plan s':>8}")
    for row, figures in table.items():
        length, angle, *others = (getattr(figures, f.name) for f in fields(Figures))
        mean, most, took = ("" if math.isnan(value) else f"{value:.2f}" for value in others)
        print(f"{row.name():40}{length:>10.4f}{angle:>10.5f}{mean:>9}{most:>8}{took:>8}")


if __name__ == "__main__":
    sys.exit(main())
