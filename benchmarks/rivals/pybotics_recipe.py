"""pybotics' own calibration on a problem as large as ours; runs in an environment of its own.

A UR10 with a tool: 22 of its 24 modified Denavit-Hartenberg parameters are free (of three parallel
axes, two offsets along them cannot be told apart), 120 points are measured with 0.015/√3 mm a
coordinate, 100 further ones are unseen. The recipe is that of pybotics' example of calibration:
`OptimizationHandler`, `optimize_accuracy` and SciPy's `least_squares` as it comes.

Says the versions in one JSON line; then, for every line read, solves once and says what it cost
and what is left of the error on the unseen points.
"""

import importlib.metadata
import json
import math
import sys
import time

import numpy as np
from pybotics.optimization import OptimizationHandler, compute_absolute_errors, optimize_accuracy
from pybotics.predefined_models import ur10
from pybotics.robot import Robot
from scipy.optimize import least_squares

POINTS, UNSEEN = 120, 100
NOISE_MM = 0.015 / math.sqrt(3.0)
TOOL_MM = (50.0, 30.0, 100.0)
ERRORS = np.array([np.radians(0.3), 0.5, np.radians(0.3), 0.5])
"""Largest error of a link's alpha, a, theta, d: rad and mm."""
HELD = ((1, 3), (2, 3))
"""d of the second and third link."""
PACKAGES = ("pybotics", "numpy", "scipy")


def main() -> None:
    rng = np.random.default_rng(1)
    nominal, real = robot(), robot()
    free = np.ones((6, 4), dtype=bool)
    for link, parameter in HELD:
        free[link, parameter] = False
    errors = np.where(free, rng.uniform(-1.0, 1.0, free.shape) * ERRORS, 0.0)
    real.kinematic_chain.vector = nominal.kinematic_chain.vector + errors.ravel()
    joints = rng.uniform(-np.pi, np.pi, (POINTS + UNSEEN, 6))
    exact = np.array([real.fk(q)[:3, 3] for q in joints])
    measured = exact[:POINTS] + NOISE_MM * rng.standard_normal((POINTS, 3))
    say({name: importlib.metadata.version(name) for name in PACKAGES})
    for _ in sys.stdin:
        began_s = time.process_time()
        found = calibrated(nominal, free, joints[:POINTS], measured)
        seconds = time.process_time() - began_s
        left = compute_absolute_errors(joints[POINTS:], exact[POINTS:], found)
        say({"seconds": seconds, "unseen_max_mm": float(left.max())})


def robot() -> Robot:
    built = Robot.from_parameters(ur10())
    built.tool.position = TOOL_MM
    return built


def calibrated(nominal: Robot, free: np.ndarray, joints: np.ndarray, points: np.ndarray) -> Robot:
    handler = OptimizationHandler(nominal, kinematic_chain_mask=free.ravel())
    result = least_squares(
        fun=optimize_accuracy,
        x0=handler.generate_optimization_vector(),
        args=(handler, joints, points),
    )
    handler.apply_optimization_vector(result.x)
    return handler.robot


def say(document: dict[str, object]) -> None:
    print(json.dumps(document), flush=True)


if __name__ == "__main__":
    main()
