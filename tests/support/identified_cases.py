"""Shots of known robots, and how they are identified, for the tests of identification."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
from fake_cell import CENTRE, NOMINAL
from family_cases import VECTORS, flat_in
from par4_space import SPACE, par4
from small_plans import LIMITS

from campaigns.design.pose_sampling import FeasibleRegion, interior_poses
from campaigns.estimation.estimators import Estimator, Model, Outliers
from campaigns.estimation.rigid_transforms import from_paper_angles
from campaigns.evaluation.diagnostics import Doubt
from campaigns.identification.identify import identify
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.parameter_selection import select_parameters
from campaigns.identification.result import IdentificationResult
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.par4 import PAR4
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots
from campaigns.shots.shots_csv import read_shots

NOISE_MM = 0.015 / 3**0.5
IMPOSSIBLE_RAD = np.radians([90.0, -90.0, 90.0, -90.0])
FOUND: dict[object, tuple[Shots, object, IdentificationResult]] = {}
"""Results by shots and how they were asked for; kept with the shots, whose ids are the keys."""
TRACKER_FROM_BASE = from_paper_angles(np.array([2.1, 0.02, -0.03]), np.array([2500.0, 400, 300]))


def reference(case: str) -> dict[str, object]:
    return json.loads((VECTORS / f"{case}.json").read_text(encoding="utf-8"))


TRUTH = par4(flat_in(reference("table1-exact")["truth"]))


def measured(case: str) -> Shots:
    rows = read_shots(VECTORS / f"{case}.csv", PAR4)
    return dataset(
        np.array([row.joints for row in rows]),
        np.array([row.point_in_tracker_mm for row in rows]),
        [row.pair for row in rows],
        [row.purpose for row in rows],
    )


def dataset(joints, points, pairs, purposes) -> Shots:
    """Shots of which the tracker states nothing."""
    count = len(joints)
    return Shots(
        numbers=tuple(range(count)),
        purposes=tuple(purposes),
        pairs=tuple(pairs),
        joints=joints,
        points_in_tracker_mm=points,
        stated_covariance_mm2=np.full((count, 3, 3), np.nan),
        approach=np.zeros_like(joints),
        commanded=np.full((count, 4), np.nan),
        measured_utc=("",) * count,
        temperature_degC=np.full(count, np.nan),
    )


def region(geometry: Kinematics = NOMINAL) -> FeasibleRegion:
    return FeasibleRegion(
        geometry, LIMITS, CENTRE, np.array([2500.0, 0.0, 0.0]), np.eye(3)[0], np.pi
    )


@cache
def workspace(count: int = 300) -> np.ndarray:
    return interior_poses(region(), count, np.random.default_rng(77))


def simulated(fitted: int, unseen: int, seed: int, truth: Kinematics = TRUTH) -> Shots:
    """Pairs measured by a perfect tracker; a seed gives their places."""
    poses = interior_poses(region(), 2 * (fitted + unseen), np.random.default_rng(seed))
    joints = NOMINAL.inverse(poses).values_or_raise()
    purposes = [ShotSet.IDENTIFICATION] * (2 * fitted) + [ShotSet.VALIDATION] * (2 * unseen)
    pairs = np.repeat(np.arange(fitted + unseen), 2).tolist()
    points = TRACKER_FROM_BASE.apply(truth.forward(joints).values_or_raise()[:, :3])
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
    outliers: Outliers = Outliers.EXCLUDE,
    model: Model | None = None,
    poses=None,
) -> IdentificationResult:
    """Identification of shots; the same shots in the same way are fitted once."""
    how = (estimator, tuple(free), tuple(fix), tuple(prior), outliers, model)
    key = (id(data), id(poses), how)
    if key not in FOUND:
        options = IdentificationOptions(
            estimator=estimator, outliers=outliers, model=model, workspace=poses
        )
        found = identify(NOMINAL, data, select_parameters(SPACE, free, fix, prior), options)
        FOUND[key] = (data, poses, found)
    return FOUND[key][-1]


def found_with(data: Shots, **options) -> IdentificationResult:
    return identify(NOMINAL, data, select_parameters(SPACE), IdentificationOptions(**options))


def doubt(found: IdentificationResult, name: str) -> Doubt | None:
    return next((each for each in found.doubts if each.name == name), None)


def values(found: IdentificationResult) -> dict[str, float]:
    return found.flat()


def deviations(found: IdentificationResult) -> dict[str, float | None]:
    return {name: parameter.std for name, parameter in found.parameters.items()}


def shortened(forearms_mm: float) -> Kinematics:
    flat_values = NOMINAL.parameters
    shorter = {n: v - forearms_mm for n, v in flat_values.items() if n.endswith("forearm_mm")}
    return par4(flat_values | shorter)


def all_but(names: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(name for name in SPACE.names if name not in names)
