"""Why `par4-prototype` reads the paper's Table I as it does (docs/model.md, docs/adr/0002).

For each reading of the table: a robot whose truth is Table II's estimates, commanded with the
nominal values, does the paper's tests without any noise. Beside it what the paper measured.

python -m benchmarks.paper_reading
"""

from collections.abc import Callable, Mapping

import numpy as np

from campaigns.arrays import Array
from campaigns.design.pose_sampling import FeasibleRegion, boundary_poses, random_pairs
from campaigns.estimation.point_sets import (
    away_from_best_line,
    distances_mm,
    farthest_apart,
    longest_mm,
)
from campaigns.mechanisms.mechanism import Kinematics, Limits, NoSolution
from campaigns.mechanisms.par4 import PAR4
from campaigns.robots.robot import find_robot
from sim.scenarios.scenario import load_scenario

CENTRE = np.array([0.0, 0.0, -575.0, 0.0])
LINES_MM = (800.0, 800.0, 500.0)
POINTS = 17
GRID_MM = 25.0
SEEDS = 7
PAIRS = 60
ARMS, NAMES = PAR4.parameters.arms, PAR4.parameters.names
PAPER = ("paper, measured", "5.48", "5.62", "0.91", "about 2")

Flat = Mapping[str, float]


def main() -> None:
    prototype, printed = flat_of("par4-prototype"), flat_of("par4-table1")
    table2 = load_scenario("paper-prototype").robot.errors
    print(f"poses on a {GRID_MM:g} mm grid with every joint within ±45°, θ = 0")
    print(f"  as printed      {reachable_on_grid(printed):5d}")
    print(f"  par4-prototype  {reachable_on_grid(prototype):5d}")
    print("\nstraightness along x, y, z and motion in the rotation test, mm (- : out of reach)")
    row(*PAPER)
    row("as printed", *tests(printed, table2))
    for length_mm in (650.0, 700.0, 750.0):
        radial = with_forearms(prototype, length_mm)
        row(f"radial arms, L = {length_mm:g}", *tests(radial, table2))
    for length_mm in (650.0, 700.0, 750.0):
        flipped = with_forearms(mirrored(printed), length_mm)
        row(f"printed α, x of motors flipped, L = {length_mm:g}", *tests(flipped, table2))
    print(f"\nlargest distance error of {PAIRS} pairs before calibration, mm, {SEEDS} draws")
    for table, scenario, paper in (
        ("Table I", "paper-simulation", "about 10"),
        ("Table II", "paper-prototype", "above 20"),
    ):
        found = largest_errors_mm(prototype, load_scenario(scenario).robot.errors)
        print(f"  {table:9} {min(found):4.1f} … {max(found):4.1f}   paper: {paper}")


def par4(flat: Flat) -> Kinematics:
    return Kinematics.from_flat(PAR4, flat)


def row(name: str, *values: str) -> None:
    print(f"  {name:42}" + "".join(f"{value:>9}" for value in values))


def flat_of(robot: str) -> dict[str, float]:
    return find_robot(robot).robot.geometry_flat()


def with_forearms(flat: Flat, length_mm: float) -> dict[str, float]:
    return {**flat, **{f"arm{arm}.forearm_mm": length_mm for arm in range(ARMS)}}


def mirrored(flat: Flat) -> dict[str, float]:
    return {**flat, **{f"arm{arm}.x_mm": -flat[f"arm{arm}.x_mm"] for arm in range(ARMS)}}


def reachable_on_grid(flat: Flat) -> int:
    """Poses that the inverse model has an answer for, whatever else would stand against them."""
    axis = np.arange(-1000.0, 1000.0 + GRID_MM, GRID_MM)
    x, y = (values.ravel() for values in np.meshgrid(axis, axis))
    limit_rad, found = np.radians(45.0), 0
    for z in axis:
        poses = np.column_stack([x, y, np.full_like(x, z), np.zeros_like(x)])
        joints = par4(flat).inverse(poses).values
        found += int((np.abs(joints) <= limit_rad).all(axis=1).sum())  # NaN is not within
    return found


def tests(nominal: Flat, errors: Flat) -> list[str]:
    """Three lines and the rotation, commanded with nominal parameters."""
    return [
        *(tested(nominal, errors, line(axis), straightness_mm) for axis in range(3)),
        tested(nominal, errors, turn(), rotation_mm),
    ]


def line(axis: int) -> Array:
    poses = np.tile(CENTRE, (POINTS, 1))
    poses[:, axis] += np.linspace(-0.5, 0.5, POINTS) * LINES_MM[axis]
    return poses


def turn() -> Array:
    poses = np.tile(CENTRE, (POINTS, 1))
    poses[:, 3] = np.radians(np.linspace(-45.0, 45.0, POINTS))
    return poses


def tested(nominal: Flat, errors: Flat, poses: Array, figure: Callable[[Array], float]) -> str:
    try:
        value = figure(reached(nominal, errors, poses)[:, :3])
    except NoSolution:
        return "-"
    return f"{value:.2f}"


def straightness_mm(points: Array) -> float:
    """Largest distance of points (N, 3) from their best line."""
    return longest_mm(away_from_best_line(points))


def rotation_mm(points: Array) -> float:
    """Largest distance between any two points (N, 3)."""
    first, second = farthest_apart(points)
    return float(np.linalg.norm(points[first] - points[second]))


def reached(nominal: Flat, errors: Flat, poses: Array) -> Array:
    """Where a robot with these errors goes when its controller believes the nominal parameters."""
    true = {name: nominal[name] + errors.get(name, 0.0) for name in NAMES}
    joints = par4(nominal).inverse(poses).values_or_raise()
    return par4(true).forward(joints, poses).values_or_raise()


def largest_errors_mm(nominal: Flat, errors: Flat) -> list[float]:
    """Commanded against true distances of the paper's recipe, drawn several times."""
    limits = find_robot("par4-prototype").robot.limits
    return [largest_error_mm(nominal, errors, limits, seed) for seed in range(SEEDS)]


def largest_error_mm(nominal: Flat, errors: Flat, limits: Limits, seed: int) -> float:
    geometry, rng = par4(nominal), np.random.default_rng(seed)
    seen_from_everywhere = FeasibleRegion(
        geometry, limits, CENTRE, np.array([2500.0, 0.0, -500.0]), np.array([1.0, 0.0, 0.0]), np.pi
    )
    poses = boundary_poses(seen_from_everywhere, 2 * PAIRS, rng)
    assert geometry.feasibility(limits, poses).feasible.all()
    first, second = random_pairs(poses, rng).T
    commanded = distances_mm(poses[:, :3], first, second)
    true = distances_mm(reached(nominal, errors, poses)[:, :3], first, second)
    return float(np.abs(commanded - true).max())


if __name__ == "__main__":
    main()
