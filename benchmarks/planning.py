"""What shots tell, by how they are placed, and what planning costs: the table of docs/planning.md.

python -m benchmarks.planning [--repeats N] [--json]

σ of the worst length and angle, and the predicted error of position over the workspace in the frame
that the same shots gave, for a tracker with 0.015/√3 mm per coordinate; medians over draws, of each
optimal plan over so many repeats. Planning is given in seconds of one core. Efficiencies are the
criterion's value of the best of many refinements from random poses, over a plan's own (I and A:
mean variances, E: the largest, D: the geometric mean). A second table has robots 5 mm and 3° off,
by plans for the nominal one and for each itself. Exit code 1 when a figure misses its limit.
"""

import math
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from benchmarks.shared.prototype import (
    CENTRE,
    EVERYWHERE,
    FREE,
    FREE_ANGLES,
    FREE_PLACES,
    NOMINAL,
    REGION,
    ROBOT,
)
from benchmarks.shared.rounds import medians, timed_s
from benchmarks.shared.yardstick import Figure, Report, Table, main
from campaigns.arrays import Array, Index
from campaigns.design.criteria import CriterionName
from campaigns.design.exchange import EXCHANGE_REGULARISATION, covariance_of
from campaigns.design.pose_sampling import boundary_poses, interior_poses, random_pairs
from campaigns.estimation.estimators import Estimator
from campaigns.estimation.information import (
    point_jacobian,
    position_std_mm,
    predict_distances,
    predict_points,
)
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.planning.optimal_plan import (
    CandidateSet,
    OptimalRequest,
    choose_measurements,
    draw_candidates,
)
from campaigns.planning.plans import PlanRequest, region_of, with_reserve

NOISE_MM = 0.015 / math.sqrt(3.0)
ISOTROPIC = TrackerUncertainty(NOISE_MM, 0.0, NOISE_MM, 0.0)
RANDOM_DRAWS = 21
WORKSPACE_SAMPLE = 2000
LENGTH, ANGLE = "length, mm", "angle, °"
MEAN, MOST = "mean position, µm", "max position, µm"
PLANNING = "planning, s"


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
CRITERIA: tuple[CriterionName, ...] = ("I", "D", "A", "E")
DISTANCES, POINTS = Estimator.DISTANCES, Estimator.POINTS
LIMITS: dict[Row, dict[str, float]] = {
    Row(120, DISTANCES, "random"): {},
    Row(120, DISTANCES, "near the limits"): {},
    Row(120, DISTANCES, "I-optimal", "I"): {},
    Row(120, POINTS, "random"): {},
    Row(120, POINTS, "near the limits"): {},
    Row(120, POINTS, "D-optimal", "D"): {},
    Row(120, POINTS, "I-optimal", "I"): {LENGTH: 0.0135, ANGLE: 0.0012, MEAN: 3.3, PLANNING: 4.5},
    Row(40, POINTS, "I-optimal", "I"): {LENGTH: 0.024},
    Row(14, POINTS, "I-optimal", "I"): {LENGTH: 0.06},
}

RANDOM_STARTS = {14: 50, 40: 10, 120: 3}
"""Refinements from random poses, by number of shots."""
REFINED = 120
"""Rounds of each of them: more than a plan is refined by."""
EFFICIENT = 0.97
ROBOTS = 9
"""Robots drawn, each parameter uniformly within 5 mm or 3° of nominal."""


def measure(repeats: int) -> Report:
    rows: list[tuple[str | float, ...]] = []
    judged: list[Figure] = []
    for row, limits in LIMITS.items():
        draws = range(repeats if row.criterion else RANDOM_DRAWS)
        found = medians([one_draw(row, np.random.default_rng(seed)) for seed in draws])
        rows.append((row.name(), *found.values()))
        for figure, limit in limits.items():
            judged.append(Figure(f"{row.name()}: {figure}", found[figure], highest=limit))
    title = "standard deviations of the worst, errors of position"
    table = Table(title, ("", LENGTH, ANGLE, MEAN, MOST, PLANNING), rows)
    judged += [
        Figure(f"{shots} shots, {name}: efficiency", efficiency(name, shots), lowest=EFFICIENT)
        for shots in RANDOM_STARTS
        for name in CRITERIA
    ]
    after = [after_identify(14, np.random.default_rng(seed)) for seed in range(ROBOTS)]
    lost, worse = np.array(after).T
    title = f"{ROBOTS} robots 5 mm and 3° off, 14 shots: planned for the nominal one"
    heads = ("", "robots with shots that cannot be taken", "mean position's σ, of the others' own")
    own = float(np.nanmedian(np.where(lost > 0, math.nan, worse)))
    others = Table(title, heads, [("I-optimal", float(np.sum(lost > 0)), own)])
    return Report(judged, [table, others])


def after_identify(shots: int, rng: np.random.Generator) -> tuple[float, float]:
    """Shots of a nominal plan that a robot cannot take, and their σ by that of a plan for it.

    The mean σ of its positions, NaN where the shots that are left leave parameters undetermined.
    """
    p = NOMINAL.p.copy()
    p[FREE_PLACES] += np.where(FREE_ANGLES, np.radians(3.0), 5.0) * rng.uniform(-1, 1, len(FREE))
    robot, limits = replace(NOMINAL, p=p), with_reserve(ROBOT)
    by_nominal = region_of(NOMINAL, limits, EVERYWHERE, CENTRE)
    by_own = region_of(robot, limits, EVERYWHERE, CENTRE)
    commanded = region_of(NOMINAL, ROBOT.limits, EVERYWHERE, CENTRE)
    workspace = interior_poses(by_own, WORKSPACE_SAMPLE, rng)
    at = robot.inverse(workspace).values_or_raise()
    judged = point_jacobian(robot, FREE, at, workspace)
    request, lost, std_mm = request_of(shots, POINTS, "I"), list[int](), list[float]()
    for region in (by_nominal, replace(by_own, commanded=commanded)):
        chosen = choose_measurements(draw_candidates(region, request, rng), request, rng)
        joints = region.kinematics.inverse(chosen.poses).values_or_raise()
        taken = robot.forward(joints, near=chosen.poses)
        poses = taken.values[taken.found]
        noise = np.broadcast_to(NOISE_MM**2 * np.eye(3), (len(poses), 3, 3))
        known, _ = predict_points(robot, FREE, joints[taken.found], poses, noise)
        known = np.where(np.isfinite(known), known, np.nan)
        lost.append(int(np.sum(~taken.found)))
        std_mm.append(float(position_std_mm(judged, known).mean()))
    return float(lost[0]), std_mm[0] / std_mm[1]


def efficiency(name: CriterionName, shots: int) -> float:
    """Efficiency of a plan against the best of refinements from random poses."""
    options, request = drawn(Row(shots, POINTS, "optimal", name), np.random.default_rng(0))
    plan = choose_measurements(options, request, np.random.default_rng(1))
    values = []
    for seed in range(RANDOM_STARTS[shots]):
        rng = np.random.default_rng(100 + seed)
        found = options.only(rng.choice(len(options.candidates), shots, replace=False))
        values.append(judged_value(name, found.refined(options, REFINED, rng)))
    return min(values) / judged_value(name, plan)


def judged_value(name: CriterionName, found: CandidateSet) -> float:
    """Value of a criterion; of E the largest eigenvalue itself, which plans look for smoothed."""
    if name != "E":
        return found.value
    known = covariance_of(found.candidates, found.candidates.jacobians, EXCHANGE_REGULARISATION)
    own = slice(found.candidates.parameters)
    return float(np.linalg.eigvalsh(known[own, own])[-1])


def one_draw(row: Row, rng: np.random.Generator) -> dict[str, float]:
    """Errors of position are NaN where the shots give no frame, time where nothing is planned."""
    placed: list[tuple[Array, Index]] = []
    took_s = timed_s(lambda: placed.append(place(row, rng)))
    poses, pairs = placed[0]
    joints = NOMINAL.inverse(poses).values_or_raise()
    figures = by_distances if row.estimator == DISTANCES else partial(by_points, rng=rng)
    return figures(joints, poses, pairs) | {PLANNING: took_s if row.criterion else math.nan}


def place(row: Row, rng: np.random.Generator) -> tuple[Array, Index]:
    """Poses (N, 4) and pairs of them (N/2, 2)."""
    if row.criterion is None:
        poses = PLACES[row.place](REGION, row.shots, rng)
        return poses, random_pairs(poses, rng)
    options, request = drawn(row, rng)
    return choose_measurements(options, request, rng).poses, np.arange(row.shots).reshape(-1, 2)


def drawn(row: Row, rng: np.random.Generator) -> tuple[CandidateSet, OptimalRequest]:
    """Candidates for an optimal plan."""
    assert row.criterion is not None, "chosen"
    request = request_of(row.shots, row.estimator, row.criterion)
    return draw_candidates(REGION, request, rng), request


def request_of(shots: int, estimator: Estimator, criterion: CriterionName) -> OptimalRequest:
    """Request for an optimal plan of the standard model."""
    return OptimalRequest(
        plan=PlanRequest(shots, 0, 2, CENTRE),
        uncertainty=ISOTROPIC,
        free=FREE,
        estimator=estimator,
        criterion=criterion,
    )


def by_distances(joints: Array, poses: Array, pairs: Index) -> dict[str, float]:
    variance = np.full(len(pairs), 2.0 * NOISE_MM**2)
    known, _ = predict_distances(NOMINAL, FREE, joints, poses, pairs, variance)
    return worst(np.sqrt(np.diag(known))) | {MEAN: math.nan, MOST: math.nan}


def by_points(
    joints: Array, poses: Array, _pairs: Index, rng: np.random.Generator
) -> dict[str, float]:
    workspace = interior_poses(REGION, WORKSPACE_SAMPLE, rng)
    noise = np.broadcast_to(NOISE_MM**2 * np.eye(3), (len(poses), 3, 3))
    known, _ = predict_points(NOMINAL, FREE, joints, poses, noise)
    there = NOMINAL.inverse(workspace).values_or_raise()
    jacobian = point_jacobian(NOMINAL, FREE, there, workspace)
    error_um = 1e3 * position_std_mm(jacobian, known)
    std = np.sqrt(np.diag(known))[: len(FREE)]
    return worst(std) | {MEAN: float(error_um.mean()), MOST: float(error_um.max())}


def worst(std: Array) -> dict[str, float]:
    return {
        LENGTH: float(std[~FREE_ANGLES].max()),
        ANGLE: float(np.degrees(std[FREE_ANGLES].max())),
    }


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure, repeats=3))
