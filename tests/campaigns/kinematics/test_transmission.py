"""Transmission of joints: against independent shots, by differences, for every member."""

import json

import numpy as np
import pytest
from family_cases import ALL_MEMBERS, BY_NAME, VECTORS, all_members, flat_in
from par4_cases import NOMINAL, central_differences

from campaigns.fit.error_model import ErrorModel, Observations, first_frames, moved_frames
from campaigns.fit.error_sources import TRACKER_SOURCES
from campaigns.kinematics.parameters import Role
from campaigns.kinematics.transmission import approach_along, terms
from campaigns.shots.shots import shots_of_rows
from campaigns.shots.shots_csv import read_shots
from sim.geometry import PLATE_KINDS, geometry_of
from sim.robot.rods import Build, Growth, Plate, RodMechanism

SIZES = {"deg": np.radians(0.03), "mm": 0.04, "ppm": 300e-6}
FIELDS = {
    "a_deg": "eccentricity_sin_deg",
    "b_deg": "eccentricity_cos_deg",
    "c_deg": "ripple_sin_deg",
    "d_deg": "ripple_cos_deg",
    "beta_deg": "backlash_deg",
}


def geared(member, **sizes):
    """Perturbed robot whose joints all have every error, and sides of approach of three shots.

    Sizes are by group instead of all alike; loads of joints change a little with all else. Ripples
    of the joints come at unlike rates.
    """
    robot = member.perturbed
    rate = 30.0 if member.mechanism.joints[0].is_revolute else 20.0
    rates = [rate + 3.0 * arm for arm in range(member.space.arms)]
    p, space, draw = robot.p.copy(), member.space, np.random.default_rng(3)
    for name in space.select(Role.TRANSMISSION):
        size = sizes.get(space[name].field.group, SIZES[space[name].unit])
        p[space.places([name])] = size * draw.uniform(-1.0, 1.0)
    poses = member.reachable_poses(robot, 3, seed=5, limits=member.well_inside)
    own = type(robot)(robot.mechanism.with_ripples(rates), p)
    approach = draw.choice([-1.0, 0.0, 1.0], (3, space.arms))
    approach[0] = 1.0
    return own, poses, approach


@all_members
def test_readings_and_poses_undo_each_other_from_either_side(member):
    robot, poses, approach = geared(member)
    joints = robot.inverse(poses, approach).values_or_raise()
    found = robot.forward(joints, approach=approach).values_or_raise()
    assert np.abs(found - poses).max() < 1e-9
    assert np.abs(robot.forward(joints).values_or_raise() - poses).max() > 1e-3
    assert np.abs(member.perturbed.inverse(poses).values_or_raise() - joints).max() > 1e-5


@pytest.mark.parametrize(
    ("member", "loads", "within"),
    [(member, 0.0, 1e-6) for member in ALL_MEMBERS]
    + [(BY_NAME[name], 5e-4, 3e-3) for name in ("par4", "linear-delta")],
)
def test_derivatives_by_every_parameter_are_those_of_differences(member, loads, within):
    robot, poses, approach = geared(member, compliance=loads)
    joints, space = robot.inverse(poses, approach).values_or_raise(), member.space
    gears = space.places(space.select(Role.TRANSMISSION))
    scale = np.where(np.array([space[name].unit for name in space.of_robot]) == "mm", 1.0, 300.0)

    def moved(vector):
        return type(robot)(robot.mechanism, vector).forward(joints, poses, approach).values

    exact = robot.jacobian(joints, poses, approach) / scale
    differences = central_differences(moved, robot.p, 0.01 / scale) / scale
    assert np.abs(exact - differences).max() < within * np.abs(exact).max()
    assert (np.abs(exact[:, :, gears]).max(axis=(0, 1)) > 1e-3).all()


@all_members
def test_a_joint_ripples_at_its_own_rate_and_without_one_not_at_all(member):
    is_crank, arms = member.mechanism.joints[0].is_revolute, member.space.arms
    mechanism = member.mechanism.with_ripples((7.0, *[0.0] * (arms - 2), 20.0))
    phase_rate = [7.0 if is_crank else 2.0 * np.pi / 7.0, 20.0 if is_crank else np.pi / 10.0]
    assert mechanism.phase_rate == pytest.approx(
        [phase_rate[0], *[0.0] * (arms - 2), phase_rate[1]]
    )
    assert [mechanism.has_ripple(arm) for arm in (0, 1, arms - 1, None)] == [
        True,
        False,
        True,
        True,
    ]
    joints = np.linspace(-0.3, 0.4, 5)[:, None] * np.ones(arms)
    factors = terms(joints, None, mechanism.phase_rate)
    for arm, rate in ((0, phase_rate[0]), (arms - 1, phase_rate[1])):
        assert factors["ripple_sin"][:, arm] == pytest.approx(np.sin(rate * joints[:, arm]))
        assert factors["ripple_cos"][:, arm] == pytest.approx(np.cos(rate * joints[:, arm]))
    assert not factors["ripple_sin"][:, 1:-1].any()
    assert not factors["ripple_cos"][:, 1:-1].any()


def test_a_mechanism_has_one_rate_for_all_joints_or_one_for_each():
    mechanism = NOMINAL.mechanism
    assert (mechanism.rates, mechanism.rate, mechanism.has_ripple(None)) == ((0.0,) * 4, 0.0, False)
    assert mechanism.with_ripples(30.0).rates == (30.0,) * 4
    assert mechanism.with_ripples(30.0).rate == 30.0
    assert mechanism.with_ripples((30.0, 0.0, 0.0, 0.0)).rate == 0.0
    assert mechanism.with_ripples(30.0).with_ripples(0.0) == mechanism
    with pytest.raises(ValueError, match="3 ripple rates for 4 joints"):
        mechanism.with_ripples((30.0, 30.0, 30.0))


@pytest.mark.parametrize("part", [0, 1, 2], ids=["arms", "forearms", "frame"])
@all_members
def test_warm_parts_move_points_as_independent_rods_do(member, part):
    """Arms or scales of rails, forearms, and the frame from its origin to where the limbs are."""
    robot, share = member.nominal.controlled, 1e-5
    kind, flat, level = PLATE_KINDS[member.name], robot.parameters, np.zeros(member.space.arms)
    build = Build(np.array(robot.mechanism.plate.joints_mm), 80.0, np.zeros((len(level), 2)), level)
    rods = RodMechanism(geometry_of({name: flat[name] for name in kind.names}, kind), build)
    poses = member.reachable_poses(robot, 5, seed=6, limits=member.well_inside)
    joints = robot.inverse(poses).values_or_raise()
    starts = [Plate.level(kind, row[:3], float(row[3:].sum())) for row in poses]
    growth = Growth(*(share * np.eye(3)[part]))
    true = [rods.settle(*each, growth)[0].position_mm for each in zip(joints, starts, strict=True)]
    by_p = robot.jacobian(joints, poses)[:, :3]
    columns = robot.mechanism.growth_columns(robot.p, by_p, joints)
    moved = np.array(true) - poses[:, :3]
    assert np.abs(moved).max() > 1e-3
    assert np.abs(moved - share * columns[..., part]).max() < 1e-4 * np.abs(moved).max()


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
    table, expected = nominal.mechanism.parameters, named(answers[answer])
    gears = [name for name in table.select(Role.TRANSMISSION) if name in expected]
    free = {*BY_NAME["par4"].free, *gears}
    assert len(free) == 42
    held = {*table.select(), *TRACKER_SOURCES} - free
    found = least_squares(ErrorModel(nominal, held), data)
    for name, value in zip(found.parameters.table.of_robot, found.p, strict=True):
        if name in free:
            apart = value / table.file_unit[table.places([name])[0]] - expected[name]
            assert abs(apart) < within[table[name].unit], name


def least_squares(model, data):
    """Robot that fits shots best by their stated covariance, without priors."""
    observed = Observations(
        joints=data.joints,
        approach=data.approach,
        near=data.commanded,
        points=data.points_in_tracker_mm,
        noise={},
        frame=np.zeros(len(data), dtype=int),
        warmth=np.zeros(len(data)),
        moment=np.arange(len(data)) * 1.0,
        time=np.linspace(0.0, 1.0, len(data)),
        former=data.joints,
    )
    _, assembly = model.positions(np.zeros(len(model.names)), observed, observed.near)
    frames, _ = first_frames(observed, assembly.poses[:, :3], assembly.is_solved)
    whitening = np.linalg.inv(np.linalg.cholesky(data.stated_covariance_mm2))
    x = np.zeros(len(model.names))
    for _ in range(12):
        at = model.predict(x, frames, observed, observed.near)
        rows = (whitening @ at.jacobian).reshape(-1, at.jacobian.shape[2])
        residual = (whitening @ at.residual[..., None]).ravel()
        step = np.linalg.lstsq(rows, -residual, rcond=None)[0]
        x, frames = x + step[: len(x)], moved_frames(frames, step[len(x) :])
    return model.kinematics(x)


def test_joints_keep_the_side_that_they_came_from_while_they_stand():
    joints = np.array([[0.0, 1.0], [0.1, 1.0], [0.1, 0.9], [0.0, 0.9]])
    assert approach_along(joints).tolist() == [[0, 0], [1, 0], [1, -1], [-1, -1]]
