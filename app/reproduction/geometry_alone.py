"""The rotation test and the lines without any noise: what wrong parameters alone do to them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from app.reproduction.experiments import ROBOT
from app.reproduction.summary import Distribution, distribution
from app.reproduction.trials import TrialResult
from campaigns.config_sections import ValidationConfig
from campaigns.numerics.forward import forward
from campaigns.numerics.geometry import Array, Geometry
from campaigns.numerics.par4 import inverse
from campaigns.robot import find_robot
from campaigns.validate import AXES, rotation_mm, straightness_mm

Flat = Mapping[str, float]


@dataclass(frozen=True, slots=True)
class GeometryAlone:
    """A test commanded with nominal, then with identified parameters, to the true robot, mm."""

    name: str
    before_mm: float
    after: Distribution


def geometry_alone(results: Sequence[TrialResult]) -> tuple[GeometryAlone, ...]:
    """Of seeds of one experiment: all have the same nominal and the same true robot."""
    nominal = find_robot(ROBOT).robot.geometry_flat()
    true = _with(nominal, {n: e.true_error for n, e in results[0].parameters.items()})
    before = dict(_figures(nominal, true))
    after = [
        dict(
            _figures(_with(nominal, {n: e.estimated_error for n, e in r.parameters.items()}), true)
        )
        for r in results
    ]
    return tuple(
        GeometryAlone(name, value, distribution([figures[name] for figures in after]))
        for name, value in before.items()
    )


def _with(flat: Flat, errors: Flat) -> dict[str, float]:
    return {name: value + errors.get(name, 0.0) for name, value in flat.items()}


def _figures(believed: Flat, true: Flat) -> Iterator[tuple[str, float]]:
    """Both tests as validate commands them."""
    tests = ValidationConfig()
    low, high = find_robot(ROBOT).robot.limits.theta_rad
    turn = _at_centre(tests, tests.rotation_steps)
    turn[:, 3] = np.linspace(low, high, tests.rotation_steps)
    moved = rotation_mm(_reached_mm(believed, true, turn))
    assert moved is not None, "there are more than two points"
    yield "rotation", moved
    for place, (axis, length_mm) in enumerate(zip(AXES, tests.line_lengths_mm, strict=True)):
        line = _at_centre(tests, tests.line_points)
        line[:, place] += length_mm * np.linspace(-0.5, 0.5, tests.line_points)
        yield f"straightness {axis}", straightness_mm(_reached_mm(believed, true, line))


def _at_centre(tests: ValidationConfig, count: int) -> Array:
    """The same pose (count, 4) again and again."""
    return np.tile([*tests.centre_mm, 0.0], (count, 1))


def _reached_mm(believed: Flat, true: Flat, poses: Array) -> Array:
    """Where the point goes, (N, 3), when the controller believes other parameters than are true."""
    joints = inverse(Geometry.from_flat(believed), poses).require()
    return forward(Geometry.from_flat(true), joints, poses).require()[:, :3]
