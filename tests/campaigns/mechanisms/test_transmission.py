"""Transmission of joints: against independent shots, by differences, for every member."""

import json

import numpy as np
import pytest
from family_cases import VECTORS, all_members, flat_in
from par4_cases import NOMINAL, central_differences

from campaigns.estimation.least_squares import solve
from campaigns.estimation.residuals import PointResiduals, PositionModel
from campaigns.mechanisms.transmission import approach_along
from campaigns.shots.shots import shots_of_rows
from campaigns.shots.shots_csv import read_shots

SIZES = {"deg": np.radians(0.03), "mm": 0.04, "ppm": 300e-6}
FIELDS = {
    "a_deg": "eccentricity_sin_deg",
    "b_deg": "eccentricity_cos_deg",
    "c_deg": "ripple_sin_deg",
    "d_deg": "ripple_cos_deg",
    "beta_deg": "backlash_deg",
}


def geared(member):
    """Perturbed robot whose joints all have every error, and sides of approach of three shots."""
    robot = member.perturbed
    rate = 30.0 if member.mechanism.joints[0].is_revolute else 20.0
    p, space, draw = robot.p.copy(), member.space, np.random.default_rng(3)
    for name in space.transmission:
        p[space.places([name])] = SIZES[space[name].unit] * draw.uniform(-1.0, 1.0)
    poses = member.reachable_poses(robot, 3, seed=5, limits=member.well_inside)
    own = type(robot)(robot.mechanism.with_ripples(rate), p)
    return own, poses, draw.choice([-1.0, 0.0, 1.0], (3, space.arms))


@all_members
def test_readings_and_poses_undo_each_other_from_either_side(member):
    robot, poses, approach = geared(member)
    joints = robot.inverse(poses, approach).values_or_raise()
    found = robot.forward(joints, approach=approach).values_or_raise()
    assert np.abs(found - poses).max() < 1e-9
    assert np.abs(robot.forward(joints).values_or_raise() - poses).max() > 1e-3
    assert np.abs(member.perturbed.inverse(poses).values_or_raise() - joints).max() > 1e-5


@all_members
def test_derivatives_by_every_parameter_are_those_of_differences(member):
    robot, poses, approach = geared(member)
    joints, space = robot.inverse(poses, approach).values_or_raise(), member.space
    scale = robot.mechanism.sensitivity_scale_mm(robot.p)[: len(robot.p)]

    def moved(vector):
        return type(robot)(robot.mechanism, vector).forward(joints, poses, approach).values

    exact = robot.jacobian(joints, poses, approach) / scale
    differences = central_differences(moved, robot.p, 0.01 / scale) / scale
    assert np.abs(exact - differences).max() < 1e-6 * np.abs(exact).max()
    assert (np.abs(exact[:, :, space.places(space.transmission)]).max(axis=(0, 1)) > 1e-3).all()


def shots(case):
    """Shots of a vector's file, whose columns `side0` … say how joints came, and its answers."""
    path = VECTORS / f"{case}.csv"
    data = shots_of_rows(read_shots(path, NOMINAL.mechanism), NOMINAL)
    return data, json.loads(path.with_suffix(".json").read_text(encoding="utf-8"))


def named(answer):
    """Values of an answer by the names of parameters."""
    flat = flat_in(answer["geometry"])
    return flat | {
        f"arm{arm}.{field}": value
        for key, field in FIELDS.items()
        for arm, value in enumerate(answer[key])
    }


@pytest.mark.parametrize(
    ("case", "answer", "within"),
    [
        ("transmission-exact", "truth", {"mm": 1e-6, "deg": 1e-7}),
        ("transmission-noise", "least_squares_points", {"mm": 1e-5, "deg": 1e-7}),
    ],
)
def test_all_terms_are_found_as_an_independent_model_has_them(case, answer, within):
    data, answers = shots(case)
    nominal = type(NOMINAL)(NOMINAL.mechanism.with_ripples(answers["N"]), NOMINAL.p)
    space, expected = nominal.mechanism.parameters, named(answers[answer])
    added = tuple(name for name in space.transmission if name in expected)
    free = (*space.free_by_default, *added)
    assert len(free) == 42
    model = PositionModel(nominal, space.places(free), data.joints, approach=data.approach)
    measured = data.points_in_tracker_mm, data.stated_covariance_mm2
    fit = solve(PointResiduals.from_points(model, *measured))
    found = fit.x[: len(free)] / space.units(free)
    assert fit.converged
    for name, value in zip(free, found, strict=True):
        assert abs(value - expected[name]) < within[space[name].unit], name


def test_joints_keep_the_side_that_they_came_from_while_they_stand():
    joints = np.array([[0.0, 1.0], [0.1, 1.0], [0.1, 0.9], [0.0, 0.9]])
    assert approach_along(joints).tolist() == [[0, 0], [1, 0], [1, -1], [-1, -1]]
