"""The rotation test and the lines by wrong parameters alone, and with noise drawn upon them."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from app.papers.corbel2006.experiments import ROBOT
from app.papers.corbel2006.floors import most_distant_mm, scattered, straightness_mm
from app.papers.corbel2006.summary import Distribution, distribution
from app.papers.corbel2006.trials import TrialResult
from campaigns.arrays import Array
from campaigns.evaluation.validation import AXES
from campaigns.mechanisms.mechanism import Kinematics
from campaigns.mechanisms.par4 import PAR4
from campaigns.robots.robot import find_robot
from campaigns.settings.sections import ValidationConfig

DRAWS_A_SEED = 100

Flat = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class GeometryAlone:
    """A test commanded with nominal, then with identified parameters, to the true robot, mm."""

    name: str
    before_mm: float
    after: Distribution
    """Over the seeds."""
    noisy: Distribution
    """After, with the paper's repeatability drawn upon it."""


def geometry_alone(
    results: Sequence[TrialResult], rng: np.random.Generator
) -> tuple[GeometryAlone, ...]:
    """Of seeds of one experiment: all have the same nominal and the same true robot."""
    nominal = find_robot(ROBOT).robot.geometry_flat()
    true = _with(nominal, {n: e.true_error for n, e in results[0].parameters.items()})
    identified = [
        _with(nominal, {n: e.estimated_error for n, e in result.parameters.items()})
        for result in results
    ]
    return tuple(_test(test, nominal, true, identified, rng) for test in _tests())


@dataclass(frozen=True, slots=True, eq=False)
class _Test:
    """A test's name, the poses (N, 4) that it commands, and its figure of points (N, 3)."""

    name: str
    poses: Array
    figure: Callable[[Array], float]


def _tests() -> Iterator[_Test]:
    """Those with poses of their own, as validate commands them."""
    tests = ValidationConfig()
    low, high = find_robot(ROBOT).robot.limits.task[3] or (0.0, 0.0)
    turn = _at_centre(tests, tests.rotation_steps)
    turn[:, 3] = np.linspace(low, high, tests.rotation_steps)
    yield _Test("rotation", turn, most_distant_mm)
    for place, (axis, length_mm) in enumerate(zip(AXES, tests.line_lengths_mm, strict=True)):
        line = _at_centre(tests, tests.line_points)
        line[:, place] += length_mm * np.linspace(-0.5, 0.5, tests.line_points)
        yield _Test(f"straightness {axis}", line, straightness_mm)


def _test(
    test: _Test, nominal: Flat, true: Flat, identified: Sequence[Flat], rng: np.random.Generator
) -> GeometryAlone:
    after = [_reached_mm(believed, true, test.poses) for believed in identified]
    noisy = [
        test.figure(points + scattered(rng, len(points)))
        for points in after
        for _ in range(DRAWS_A_SEED)
    ]
    return GeometryAlone(
        test.name,
        test.figure(_reached_mm(nominal, true, test.poses)),
        distribution([test.figure(points) for points in after]),
        distribution(noisy),
    )


def _with(flat: Flat, errors: Flat) -> dict[str, float]:
    return {name: value + errors.get(name, 0.0) for name, value in flat.items()}


def _at_centre(tests: ValidationConfig, count: int) -> Array:
    """The same pose (count, 4) again and again."""
    return np.tile([*tests.centre_mm, 0.0], (count, 1))


def _reached_mm(believed: Flat, true: Flat, poses: Array) -> Array:
    """Where the point goes, (N, 3), when the controller believes other parameters than are true."""
    joints = Kinematics.from_flat(PAR4, believed).inverse(poses).values_or_raise()
    return Kinematics.from_flat(PAR4, true).forward(joints, poses).values_or_raise()[:, :3]
