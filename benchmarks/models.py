"""Whether the larger model is kept when distances that it never saw say so.

python -m benchmarks.models [--robots N] [--json]

Campaigns of 60 + 20 pairs on the `realistic` cell (eight rods, tilted axes, backlash, warm arms),
one robot a seed: errors of fresh distances, which neither the fit nor the choice ever saw, by the
model that was chosen, by the standard one and by the largest. How often a larger one is kept of
robots that need none: benchmarks.transmission. Exit code 1 when a figure misses its limit.
"""

import statistics
from collections.abc import Sequence
from dataclasses import replace
from math import nan

import numpy as np

from benchmarks.shared.prototype import CENTRE, NOMINAL, ROBOT, SPACE
from benchmarks.shared.yardstick import Figure, Report, Table, main
from campaigns.arrays import Array, Index
from campaigns.estimation.estimators import Model
from campaigns.estimation.residuals import DistanceResiduals, PositionModel
from campaigns.identification.identify import identify
from campaigns.identification.model_selection import STANDARD, candidate_models, select_model
from campaigns.identification.result import IdentificationResult
from campaigns.planning.plans import PlanRequest, View, joints_of, make_plan, pairs_of
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots
from campaigns.studies.study import planned_shots
from sim.cell import Cell
from sim.random_streams import target_key
from sim.scenarios.scenario import load_scenario

SCENARIO = load_scenario("realistic")
PAIRS, UNSEEN_PAIRS, FRESH_PAIRS = 60, 20, 100
ACCEPTANCE_RAD = np.radians(25.0)
TURNED_RAD = np.radians(5.0 / 60.0)
"""A joint that moves by less than a gear's lost motion keeps the side it came from."""
SHOT_S = 1.5
NEAR_CENTRE_POSES = np.array([[0.0, 0.0, z, 0.0] for z in (-575.0, -650.0, -700.0)])
WAYPOINTS_RAD = NOMINAL.inverse(NEAR_CENTRE_POSES).values_or_raise()
MODELS = candidate_models(SPACE, Model.EXTENDED)
ALL_MODELS = {**candidate_models(SPACE, Model.AUTO), **MODELS}
LARGEST = "axes+backlash"
NEVER_WORSE, MEDIAN_RATIO = 1.10, 0.85


def measure(robots: int) -> Report:
    found = [realistic_robot(seed) for seed in range(1, robots + 1)]
    rows, gains = [row for row, _ in found], [gained for _, gained in found]
    median = statistics.median(ratio for *_, ratio in rows)
    worst = max(chosen / min(others) for _, _, chosen, *others, _ in rows)
    columns = ("seed", "model", "chosen", "standard", "largest", "ratio")
    return Report(
        [
            Figure("median chosen / standard", median, highest=MEDIAN_RATIO),
            Figure("worst chosen / better of the two", worst, highest=NEVER_WORSE),
        ],
        [
            Table("errors of fresh distances, rms in µm", columns, rows),
            Table(
                "medians by model",
                ("free", "errors over the 22's", "χ² per degree of freedom"),
                [(name, *np.median([each[name] for each in gains], 0)) for name in ALL_MODELS],
            ),
        ],
    )


def realistic_robot(
    seed: int,
) -> tuple[tuple[int, str, float, float, float, float], dict[str, tuple[float, float]]]:
    """Model chosen, rms errors (µm) by it, the standard and the largest, ratio of the first two.

    And by model the errors over the standard's, with χ² per degree of freedom.
    """
    data, fresh = measured(seed)
    choice = select_model(NOMINAL, data, MODELS)
    kept = next(each.name for each in choice.models if each.kept)
    found = {name: identify(NOMINAL, data, known) for name, known in ALL_MODELS.items()}
    left = {name: 1e3 * rms_mm(each, fresh) for name, each in found.items()}
    chosen, standard, largest = 1e3 * rms_mm(choice, fresh), left[STANDARD], left[LARGEST]
    gained = {
        name: (left[name] / standard, each.chi2.value / each.chi2.dof if each.chi2 else nan)
        for name, each in found.items()
    }
    return (seed, kept, chosen, standard, largest, chosen / standard), gained


def rms_mm(found: IdentificationResult, fresh: Shots) -> float:
    """Root mean square error of the fresh distances."""
    x = np.array([found.parameters[name].value for name in found.free]) * SPACE.units(found.free)
    places = SPACE.places(found.free)
    model = PositionModel(NOMINAL, places, fresh.joints, approach=fresh.approach)
    pairs = np.arange(len(fresh)).reshape(-1, 2)
    problem = DistanceResiduals.in_mm(
        model, pairs[:, 0], pairs[:, 1], fresh.measured_distances_mm(pairs)
    )
    errors_mm = problem.errors_mm(x)
    return float(np.sqrt(np.mean(errors_mm**2)))


def measured(seed: int) -> tuple[Shots, Shots]:
    """A campaign's shots, and fresh ones that it does not know of, in pairs of neighbours."""
    rng, station = np.random.default_rng(seed), SCENARIO.tracker.station.pose()
    tracker = station.origin_in_base_mm
    centre_mm = np.array(SCENARIO.robot.workspace_centre_mm)
    view = View(tuple(tracker), tuple(tracker - centre_mm), ACCEPTANCE_RAD)
    request = PlanRequest(2 * PAIRS, UNSEEN_PAIRS + FRESH_PAIRS, 3, CENTRE)
    plan = make_plan(ROBOT, view, request, rng)
    in_base, approach = driven(Cell(SCENARIO, seed=seed), joints_of(plan))
    points = np.array([station.to_tracker_mm(point) for point in in_base])
    noise = SCENARIO.tracker.noise
    roots = np.array([noise.spread_mm(point) for point in points])
    points += np.einsum("nij,nj->ni", roots, rng.standard_normal(points.shape))
    shots = replace(
        planned_shots(plan),
        points_in_tracker_mm=points,
        stated_covariance_mm2=roots @ roots.swapaxes(1, 2),
        approach=approach,
    )
    fresh: Index = rng.choice(pairs_of(plan, ShotSet.VALIDATION), FRESH_PAIRS, replace=False)
    known = np.setdiff1d(np.arange(len(plan)), fresh)
    return shots.rows(known), shots.rows(fresh.ravel())


def driven(cell: Cell, joints: Array) -> tuple[Array, Array]:
    """Reflector in the base frame (N, 3) after each motion, and sides came from (N, 4)."""
    robot, points, sides = cell.robot, [], []
    side = np.zeros(joints.shape[1])
    for target in joints:
        for stop in (*way(cell, target), target):
            turned = stop - robot.standing.encoders
            side = np.where(np.abs(turned) > TURNED_RAD, np.sign(turned), side)
            assert robot.passable_part(stop) == 1.0
            robot.arrive(stop, target_key(stop.tolist()))
            cell.work(SHOT_S)
        points.append(robot.reflector(target).point_mm)
        sides.append(side)
    return np.array(points), np.array(sides)


def way(cell: Cell, target: Array) -> Sequence[Array]:
    """Nothing, or a waypoint from which the target can be reached."""
    passable = (stop for stop in WAYPOINTS_RAD if cell.robot.passable_part(stop) == 1.0)
    return () if cell.robot.passable_part(target) == 1.0 else (next(passable),)


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure, robots=20))
