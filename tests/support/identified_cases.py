"""Shots of known robots, and how they are identified, for the tests of identification."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from fake_cell import CENTRE, NOMINAL
from small_plans import LIMITS

from campaigns.design.pose_sampling import FeasibleRegion, interior_poses
from campaigns.estimation.estimators import Estimator, LossShape, Outliers
from campaigns.estimation.rigid_transforms import from_paper_angles
from campaigns.estimation.robust import Loss
from campaigns.identification.identify import identify
from campaigns.identification.parameter_selection import select_parameters
from campaigns.identification.result import IdentificationRequest, IdentificationResult
from campaigns.mechanisms.forward import forward
from campaigns.mechanisms.geometry import NAMES, Geometry
from campaigns.mechanisms.par4 import inverse
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots
from campaigns.shots.shots_csv import read_shots

VECTORS = Path(__file__).parents[1] / "data" / "vectors"
NOISE_MM = 0.015 / 3**0.5
IMPOSSIBLE_RAD = np.radians([90.0, -90.0, 90.0, -90.0])
TRACKER_FROM_BASE = from_paper_angles(np.array([2.1, 0.02, -0.03]), np.array([2500.0, 400, 300]))


def reference(case: str) -> dict[str, object]:
    return json.loads((VECTORS / f"{case}.json").read_text(encoding="utf-8"))


def flat(document) -> dict[str, float]:
    arms = enumerate(document["arms"])
    values = {f"arm{i}.{key}": value for i, arm in arms for key, value in arm.items()}
    return values | {"plate_mm": document["plate_mm"]}


TRUTH = Geometry.from_flat(flat(reference("table1-exact")["truth"]))


def measured(case: str) -> Shots:
    rows = read_shots(VECTORS / f"{case}.csv")
    return dataset(
        np.array([row.joints_rad for row in rows]),
        np.array([row.point_in_tracker_mm for row in rows]),
        [row.pair for row in rows],
        [row.purpose for row in rows],
    )


def dataset(joints, points, pairs, purposes) -> Shots:
    """Shots of which the tracker states nothing."""
    unstated = np.full((len(joints), 3, 3), np.nan)
    numbers = tuple(range(len(joints)))
    unknown = np.zeros_like(joints)
    return Shots(numbers, tuple(purposes), tuple(pairs), joints, points, unstated, unknown)


def region(geometry: Geometry = NOMINAL) -> FeasibleRegion:
    return FeasibleRegion(
        geometry, LIMITS, CENTRE, np.array([2500.0, 0.0, 0.0]), np.eye(3)[0], np.pi
    )


def workspace(count: int = 300) -> np.ndarray:
    return interior_poses(region(), count, np.random.default_rng(77))


def simulated(fitted: int, unseen: int, seed: int, truth: Geometry = TRUTH) -> Shots:
    """Pairs measured by a perfect tracker; a seed gives their places."""
    poses = interior_poses(region(), 2 * (fitted + unseen), np.random.default_rng(seed))
    joints = inverse(NOMINAL, poses).require()
    purposes = [ShotSet.IDENTIFICATION] * (2 * fitted) + [ShotSet.VALIDATION] * (2 * unseen)
    pairs = np.repeat(np.arange(fitted + unseen), 2).tolist()
    points = TRACKER_FROM_BASE.apply(forward(truth, joints).require()[:, :3])
    return dataset(joints, points, pairs, purposes)


def noisy(data: Shots, seed: int, std_mm: float = NOISE_MM) -> Shots:
    """With noise of which the tracker states the usual deviation, whatever it is."""
    noise = np.random.default_rng(seed).normal(0.0, std_mm, data.points_in_tracker_mm.shape)
    return stating(replace(data, points_in_tracker_mm=data.points_in_tracker_mm + noise))


def stating(data: Shots, std_mm: float = NOISE_MM) -> Shots:
    covariance = np.tile(std_mm**2 * np.eye(3), (len(data.numbers), 1, 1))
    return replace(data, stated_covariance_mm2=covariance)


def moved(data: Shots, shots: tuple[int, ...], by_mm: float, seed: int = 0) -> Shots:
    """With some shots measured elsewhere, each in a direction of its own."""
    directions = np.random.default_rng(seed).normal(size=(len(shots), 3))
    points = data.points_in_tracker_mm.copy()
    points[list(shots)] += by_mm * directions / np.linalg.norm(directions, axis=1)[:, None]
    return replace(data, points_in_tracker_mm=points)


def identified(
    data: Shots,
    estimator: Estimator,
    *,
    free=(),
    fix=(),
    prior=(),
    loss: LossShape = LossShape.LINEAR,
    outliers: Outliers = Outliers.EXCLUDE,
    poses=None,
) -> IdentificationResult:
    known = select_parameters(free, fix, prior)
    request = IdentificationRequest(estimator, known, Loss(loss), outliers, workspace=poses)
    return identify(NOMINAL, data, request)


def values(found: IdentificationResult) -> dict[str, float]:
    return {parameter.name: parameter.value for parameter in found.parameters}


def deviations(found: IdentificationResult) -> dict[str, float | None]:
    return {parameter.name: parameter.std for parameter in found.parameters}


def shortened(forearms_mm: float) -> Geometry:
    flat_values = NOMINAL.flat()
    shorter = {n: v - forearms_mm for n, v in flat_values.items() if n.endswith("forearm_mm")}
    return Geometry.from_flat(flat_values | shorter)


def all_but(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(name for name in NAMES if name not in names)
