"""Shots of known robots, and how they are identified, for the tests of identification."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from fake_cell import CENTRE, NOMINAL
from small_plans import LIMITS

from campaigns.estimators import Estimator, LossShape, Outliers
from campaigns.identification.identified import Identification, IdentificationRequest
from campaigns.identification.identify import identify
from campaigns.identification.knowledge import knowledge
from campaigns.numerics.forward import forward
from campaigns.numerics.frames import from_paper_angles
from campaigns.numerics.geometry import NAMES, Geometry
from campaigns.numerics.par4 import inverse
from campaigns.numerics.placement import Region, inner_poses
from campaigns.numerics.robust import Loss
from campaigns.shot_sets import ShotSet
from campaigns.shots.dataset import Dataset
from campaigns.shots.exchange import read_shots

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


def measured(case: str) -> Dataset:
    rows = read_shots(VECTORS / f"{case}.csv")
    return dataset(
        np.array([row.joints_rad for row in rows]),
        np.array([row.point_in_tracker_mm for row in rows]),
        [row.pair for row in rows],
        [row.purpose for row in rows],
    )


def dataset(joints, points, pairs, purposes) -> Dataset:
    """Shots of which the tracker states nothing."""
    unstated = np.full((len(joints), 3, 3), np.nan)
    numbers = tuple(range(len(joints)))
    unknown = np.zeros_like(joints)
    return Dataset(numbers, tuple(purposes), tuple(pairs), joints, points, unstated, unknown)


def region(geometry: Geometry = NOMINAL) -> Region:
    return Region(geometry, LIMITS, CENTRE, np.array([2500.0, 0.0, 0.0]), np.eye(3)[0], np.pi)


def workspace(count: int = 300) -> np.ndarray:
    return inner_poses(region(), count, np.random.default_rng(77))


def simulated(fitted: int, unseen: int, seed: int, truth: Geometry = TRUTH) -> Dataset:
    """Pairs measured by a perfect tracker; a seed gives their places."""
    poses = inner_poses(region(), 2 * (fitted + unseen), np.random.default_rng(seed))
    joints = inverse(NOMINAL, poses).require()
    purposes = [ShotSet.IDENTIFICATION] * (2 * fitted) + [ShotSet.VALIDATION] * (2 * unseen)
    pairs = np.repeat(np.arange(fitted + unseen), 2).tolist()
    points = TRACKER_FROM_BASE.apply(forward(truth, joints).require()[:, :3])
    return dataset(joints, points, pairs, purposes)


def noisy(data: Dataset, seed: int, std_mm: float = NOISE_MM) -> Dataset:
    """With noise of which the tracker states the usual deviation, whatever it is."""
    noise = np.random.default_rng(seed).normal(0.0, std_mm, data.points_in_tracker_mm.shape)
    return stating(replace(data, points_in_tracker_mm=data.points_in_tracker_mm + noise))


def stating(data: Dataset, std_mm: float = NOISE_MM) -> Dataset:
    covariance = np.tile(std_mm**2 * np.eye(3), (len(data.numbers), 1, 1))
    return replace(data, stated_covariance_mm2=covariance)


def moved(data: Dataset, shots: tuple[int, ...], by_mm: float, seed: int = 0) -> Dataset:
    """With some shots measured elsewhere, each in a direction of its own."""
    directions = np.random.default_rng(seed).normal(size=(len(shots), 3))
    points = data.points_in_tracker_mm.copy()
    points[list(shots)] += by_mm * directions / np.linalg.norm(directions, axis=1)[:, None]
    return replace(data, points_in_tracker_mm=points)


def identified(
    data: Dataset,
    estimator: Estimator,
    *,
    free=(),
    fix=(),
    prior=(),
    loss: LossShape = LossShape.LINEAR,
    outliers: Outliers = Outliers.EXCLUDE,
    poses=None,
) -> Identification:
    known = knowledge(free, fix, prior)
    request = IdentificationRequest(estimator, known, Loss(loss), outliers, workspace=poses)
    return identify(NOMINAL, data, request)


def values(found: Identification) -> dict[str, float]:
    return {parameter.name: parameter.value for parameter in found.parameters}


def deviations(found: Identification) -> dict[str, float | None]:
    return {parameter.name: parameter.std for parameter in found.parameters}


def shortened(forearms_mm: float) -> Geometry:
    flat_values = NOMINAL.flat()
    shorter = {n: v - forearms_mm for n, v in flat_values.items() if n.endswith("forearm_mm")}
    return Geometry.from_flat(flat_values | shorter)


def all_but(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(name for name in NAMES if name not in names)
