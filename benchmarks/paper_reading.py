"""Why `par4-prototype` reads the paper's Table I as it does (docs/model.md, docs/adr/0002).

python -m benchmarks.paper_reading [--json]

For each reading of the table: a robot whose truth is Table II's estimates, commanded with the
nominal values, does the paper's tests without any noise. Beside it what the paper measured.
"""

from collections.abc import Mapping

import numpy as np

from benchmarks.shared.prototype import CENTRE, NOMINAL, REGION, ROBOT, SPACE
from benchmarks.shared.yardstick import Report, Table, main
from campaigns.arrays import Array
from campaigns.design.pose_sampling import boundary_poses, random_pairs
from campaigns.estimation import point_sets
from campaigns.mechanisms.mechanism import Kinematics, NoSolution
from campaigns.mechanisms.par4 import PAR4
from campaigns.robots.robot import find_robot, pose_row
from sim.scenarios.scenario import load_scenario

LINES_MM = (800.0, 800.0, 500.0)
POINTS = 17
SEEDS = 7
PAIRS = 60
FOREARMS_MM = (650.0, 700.0, 750.0)
PAPER_TESTS = ("paper, measured", "5.48", "5.62", "0.91", "about 2")
PAPER_ERRORS = {
    "Table I": ("paper-simulation", "about 10"),
    "Table II": ("paper-prototype", "above 20"),
}
FLIPPED = "printed α, x of motors flipped"
TESTS = "straightness and motion in the rotation test, mm (- : out of reach)"
ERRORS = f"largest distance error of {PAIRS} pairs before calibration, mm, {SEEDS} draws"

Flat = Mapping[str, float]


def measure() -> Report:
    prototype = dict(ROBOT.parameters)
    printed = find_robot("par4-table1").robot.parameters
    flipped = {f"arm{arm}.x_mm": -printed[f"arm{arm}.x_mm"] for arm in range(SPACE.arms)}
    readings: dict[str, Flat] = {"as printed": printed}
    for name, flat in {"radial arms": prototype, FLIPPED: printed | flipped}.items():
        for length_mm in FOREARMS_MM:
            forearms = {f"arm{arm}.forearm_mm": length_mm for arm in range(SPACE.arms)}
            readings[f"{name}, L = {length_mm:g}"] = flat | forearms
    table2 = load_scenario("paper-prototype").robot.errors
    tested = [(name, *tests(flat, table2)) for name, flat in readings.items()]
    errors = [(table, *error_range_mm(*paper)) for table, paper in PAPER_ERRORS.items()]
    tables = [
        Table(TESTS, ("", "x", "y", "z", "rotation"), [PAPER_TESTS, *tested]),
        Table(ERRORS, ("", "least", "most", "paper"), errors),
    ]
    return Report(tables=tables)


def tests(nominal: Flat, errors: Flat) -> list[str]:
    """Straightness along x, y and z and the rotation test, commanded with nominal parameters."""
    figures = []
    for axis, length in enumerate((*LINES_MM, np.radians(90.0))):
        poses = np.tile(pose_row(CENTRE), (POINTS, 1))
        poses[:, axis] += np.linspace(-0.5, 0.5, POINTS) * length
        try:
            points = reached(nominal, errors, poses)[:, :3]
        except NoSolution:
            figures.append("-")
            continue
        turns = axis == len(LINES_MM)
        away = point_sets.away_from_best_line(points)
        value = point_sets.diameter_mm(points) if turns else point_sets.longest_mm(away)
        figures.append(f"{value:.2f}")
    return figures


def reached(nominal: Flat, errors: Flat, poses: Array) -> Array:
    """Where a robot with these errors goes when its controller believes the nominal parameters."""
    true = {name: nominal[name] + errors.get(name, 0.0) for name in SPACE.names}
    joints = Kinematics.of(PAR4, nominal).inverse(poses).values_or_raise()
    return Kinematics.of(PAR4, true).forward(joints, poses).values_or_raise()


def error_range_mm(scenario: str, paper: str) -> tuple[float, float, str]:
    """Least and largest of several draws of the paper's recipe, beside the paper's word."""
    errors = load_scenario(scenario).robot.errors
    found = [largest_error_mm(errors, seed) for seed in range(SEEDS)]
    return min(found), max(found), paper


def largest_error_mm(errors: Flat, seed: int) -> float:
    """Commanded against true distances."""
    rng = np.random.default_rng(seed)
    poses = boundary_poses(REGION, 2 * PAIRS, rng)
    assert NOMINAL.feasibility(ROBOT.limits, poses).feasible.all()
    ends = random_pairs(poses, rng).T
    commanded = point_sets.distances_mm(poses[:, :3], *ends)
    true = point_sets.distances_mm(reached(dict(ROBOT.parameters), errors, poses)[:, :3], *ends)
    return float(np.abs(commanded - true).max())


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure))
