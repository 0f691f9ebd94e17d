"""Fits of many campaigns at once: those of one at a time, of every mechanism."""

from dataclasses import replace

import numpy as np
import pytest
from family_cases import ALL_MEMBERS

from campaigns.estimation import information, tracker_noise
from campaigns.estimation.estimators import Estimator, Model, Outliers
from campaigns.estimation.residual_stacks import closure_kernel
from campaigns.estimation.rigid_transforms import Transform, fit_frames, small_rotation
from campaigns.estimation.variance_components import component_scores
from campaigns.identification.fit import fit_shots
from campaigns.identification.fit_stack import _points, _robots, fit_stack
from campaigns.identification.model_selection import select_geometry
from campaigns.identification.observations import Inputs
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.parameter_selection import ParameterSelection
from campaigns.mechanisms import closure_coefficients
from campaigns.planning.plan_file import PlannedShot
from campaigns.shots.shot_sets import ShotSet
from campaigns.studies.study import planned_shots
from drivers.values import Pose

CAMPAIGNS, PAIRS = 4, {Model.STANDARD: 25, Model.FULL: 40}
INSTRUMENT = tracker_noise.TrackerUncertainty()
WEIGHING = ("along_mm", "along_per_mm", "across_mm", "across_per_mm", "robot_scatter_mm")
TRACKER = Transform(small_rotation(np.array([2.1, 0.02, -0.03]))[0], np.array([2500.0, 40.0, 0.0]))


def inputs_of(member, estimator, model=Model.STANDARD):
    """Inputs of a plan's shots, and points (C, N, 3) of robots that are each a bit different."""
    nominal, rng = member.nominal, np.random.default_rng(7)
    poses = member.reachable_poses(nominal, 2 * PAIRS[model], seed=3, limits=member.well_inside)
    joints, kind = nominal.inverse(poses).values_or_raise(), ShotSet.IDENTIFICATION
    shots = planned_shots(
        [
            PlannedShot(n, kind, n // 2, Pose(*pose), tuple(each))
            for n, (pose, each) in enumerate(zip(poses, joints, strict=True))
        ]
    )
    free = select_geometry(member.space, model)
    selection, options = ParameterSelection(free), IdentificationOptions(estimator=estimator)
    inputs = Inputs.of(nominal, shots, selection, replace(options, instrument=INSTRUMENT))
    places, points = member.space.places(free), []
    for _ in range(CAMPAIGNS):
        p = nominal.p.copy()
        p[places] += 0.3 * member.space.units(free) * rng.standard_normal(len(free))
        p[len(member.space.names) :] *= 0.1
        exact = TRACKER.apply(member.robot_of(p).forward(joints).values_or_raise()[:, :3])
        roots = np.linalg.cholesky(tracker_noise.point_covariance_mm2(exact, INSTRUMENT))
        points.append(exact + np.einsum("nij,nj->ni", roots, rng.standard_normal(exact.shape)))
    return inputs, np.array(points)


def kernel_of(member):
    """What `run_task` of a long study takes; made in the first test that needs it."""
    found = closure_kernel(member.nominal)
    if found is None:
        pytest.skip("numba is not installed: pip install -e '.[fast]'")
    return found


BY_NUMPY, COMPILED = lambda member: None, kernel_of
WAYS = [
    pytest.param(BY_NUMPY, id="numpy"),
    pytest.param(COMPILED, id="compiled", marks=[pytest.mark.peer, pytest.mark.timeout(0)]),
]


@pytest.mark.parametrize("model", [*PAIRS])
@pytest.mark.parametrize("estimator", list(Estimator))
@pytest.mark.parametrize("member", ALL_MEMBERS, ids=lambda member: member.name)
@pytest.mark.parametrize("way", WAYS)
def test_each_row_is_the_fit_of_its_campaign_alone_or_given_up(way, member, estimator, model):
    inputs, points_mm = inputs_of(member, estimator, model)
    points_mm[0, 5] += 0.5
    stack = fit_stack(inputs, points_mm, kernel := way(member))
    assert stack.plain[0]
    assert stack.plain[1:].any()
    for row in np.flatnonzero(stack.plain):
        shots = replace(inputs.shots, points_in_tracker_mm=points_mm[row])
        fit = fit_shots(replace(inputs, shots=shots))
        found = fit.found
        assert [place for place, *_ in fit.points.found.outliers] == ([5] if row == 0 else [])
        assert (found.fit.converged, found.noise.sigma0) == (True, 1.0)
        free = len(stack.x[row])
        np.testing.assert_allclose(stack.x[row], found.x[:free], rtol=0.0, atol=1e-9)
        covariance = found.covariance[:free, :free]
        std = np.sqrt(np.diag(covariance))
        off = (stack.covariance[row] - covariance) / np.outer(std, std)
        np.testing.assert_allclose(off, 0.0, atol=1e-7)
    alone = fit_stack(inputs, points_mm[2:3], kernel)
    np.testing.assert_array_equal(alone.x[0], stack.x[2])
    np.testing.assert_array_equal(alone.covariance[0], stack.covariance[2])
    np.testing.assert_array_equal(fit_stack(inputs, points_mm).plain, stack.plain)


@pytest.mark.peer
@pytest.mark.timeout(0)
@pytest.mark.parametrize("member", ALL_MEMBERS, ids=lambda member: member.name)
def test_compiled_scores_of_a_robots_own_scatter_are_those_by_numpy(member):
    inputs, points_mm = inputs_of(member, Estimator.POINTS)
    near = np.tile(inputs.at_nominal.values.T, (CAMPAIGNS, 1, 1))
    robots = _robots(inputs, inputs.shots.joints, near, kernel_of(member))
    covariance_mm2 = tracker_noise.point_covariance_mm2(points_mm, INSTRUMENT)
    frames = fit_frames(inputs.at_nominal.values[:, :3], points_mm)
    problem, rows = _points(robots, points_mm, covariance_mm2, frames), np.arange(CAMPAIGNS)
    x = problem.start()
    residual, _ = problem.residual(x, rows)
    problem.step(x, residual, rows)
    covariance, regular, scores = problem.scored(x, residual, rows)
    left, jacobian = residual.reshape(CAMPAIGNS, 3, -1), problem.jacobian(x, rows)
    by_x, known = jacobian.reshape(*left.shape, -1), information.covariance(jacobian)
    std = np.sqrt(np.diagonal(known, axis1=1, axis2=2))
    off = (covariance - known) / (std[:, :, None] * std[:, None])
    np.testing.assert_allclose(off, 0.0, atol=1e-9)
    known = by_x @ known[:, None]
    leverage = np.einsum("cinp,cjnp->cijn", known, by_x)
    by_joints = problem.whitened_by_joints(x, rows).swapaxes(1, 2)
    wanted = component_scores(left, leverage, problem.whitening, by_joints)
    assert regular.all()
    np.testing.assert_allclose(scores, wanted, rtol=1e-6)


def test_what_is_asked_for_beyond_plain_fits_gives_every_row_up():
    inputs, points_mm = inputs_of(ALL_MEMBERS[0], Estimator.POINTS)
    kept = replace(inputs, options=replace(inputs.options, outliers=Outliers.KEEP))
    nominal, space = inputs.nominal, inputs.nominal.mechanism.parameters
    gears = ParameterSelection((*inputs.selection.free, space.transmission[0]))
    p = np.pad(nominal.p, (0, len(space.of_robot) - len(nominal.p)))
    p[space.places(space.transmission)] = 1e-4
    for asked in (
        kept,
        replace(inputs, selection=gears),
        replace(inputs, nominal=replace(nominal, p=p)),
    ):
        assert not fit_stack(asked, points_mm).plain.any()


@pytest.mark.parametrize("way", WAYS)
def test_points_that_fix_no_frame_give_up_their_own_row_alone(way):
    inputs, points_mm = inputs_of(ALL_MEMBERS[0], Estimator.POINTS)
    whole = fit_stack(inputs, points_mm, kernel := way(ALL_MEMBERS[0]))
    points_mm[0] = [1000.0, 0.0, 0.0]
    found = fit_stack(inputs, points_mm, kernel)
    assert found.plain.tolist() == [False, *whole.plain[1:].tolist()]
    np.testing.assert_array_equal(found.x[1:], whole.x[1:])
    np.testing.assert_array_equal(found.covariance[1:], whole.covariance[1:])


def test_a_shot_far_off_whose_neighbours_the_plain_fit_bends_gives_its_row_up():
    (h4,) = (each for each in ALL_MEMBERS if each.name == "h4")
    inputs, points_mm = inputs_of(h4, Estimator.POINTS)
    points_mm[0, 29, 0] += 20.0
    assert fit_stack(inputs, points_mm[:1]).plain.tolist() == [False]


def test_distances_of_shots_without_pairs_give_every_row_up():
    inputs, points_mm = inputs_of(ALL_MEMBERS[0], Estimator.DISTANCES)
    shots = replace(inputs.shots, pairs=(None,) * len(inputs.shots))
    assert not fit_stack(replace(inputs, shots=shots), points_mm).plain.any()


@pytest.mark.parametrize("way", WAYS)
def test_points_that_are_none_and_a_pair_at_one_place_change_no_other_row(way):
    inputs, points_mm = inputs_of(ALL_MEMBERS[0], Estimator.DISTANCES)
    points_mm[0, 1], points_mm[1] = points_mm[0, 0], np.nan
    found = fit_stack(inputs, points_mm, kernel := way(ALL_MEMBERS[0]))
    assert found.plain.tolist()[:2] == [False, False]
    alone = fit_stack(inputs, points_mm[2:], kernel)
    np.testing.assert_array_equal(found.plain[2:], alone.plain)
    np.testing.assert_array_equal(found.x[2:], alone.x)


@pytest.mark.parametrize("member", ALL_MEMBERS, ids=lambda member: member.name)
def test_closures_as_numbers_are_those_of_the_mechanism(member):
    robot, mechanism = member.perturbed, member.mechanism
    places = mechanism.parameters.places(mechanism.parameters.names)
    poses = member.reachable_poses(robot, 5, seed=3)
    joints = robot.inverse(poses).values_or_raise()
    p = np.stack([member.nominal.p, robot.p], axis=1)[: len(mechanism.parameters.geometry)]
    by_platform = closure_coefficients.ends_by_platform(mechanism, robot.p)
    upper, lengths, lower, *_, by_upper, own_mm = (
        each[1] for each in closure_coefficients.closures(mechanism, p, places, by_platform)
    )
    configuration = mechanism.configuration(p[:, 1], joints)
    of_joints = closure_coefficients.joint_functions(mechanism, joints)
    turns = poses[:, 3] if poses.shape[1] > 3 else np.zeros(len(poses))
    of_turns = closure_coefficients.turn_functions(turns)
    elbows = np.einsum("aik,kan->ian", upper, of_joints)
    ends = poses[:, :3].T[:, None] + np.einsum("aik,kn->ian", lower, of_turns)
    forearms = configuration.forearms_mm(poses)
    np.testing.assert_allclose(ends - elbows, forearms, rtol=0.0, atol=1e-9)
    np.testing.assert_allclose(
        np.linalg.norm(forearms, axis=0), lengths[:, None] + 0.0 * of_joints[0], atol=1e-6
    )
    owner = closure_coefficients.owners(mechanism, places)[0]
    by_arms = configuration.arms.by_fields(forearms)
    fields = len(mechanism.parameters.arm_fields)
    for place in np.flatnonzero(owner >= 0):
        arm, field = divmod(place, fields)
        moved = np.einsum("ik,kn->in", by_upper[place], of_joints[:, arm])
        column = -2.0 * (np.einsum("in,in->n", forearms[:, arm], moved) + own_mm[place])
        np.testing.assert_allclose(column, by_arms[arm, field], rtol=1e-9, atol=1e-7)


@pytest.mark.peer
@pytest.mark.timeout(0)
def test_compiled_cosines_and_sines_are_those_of_the_library_all_around():
    angles = np.linspace(-20.0, 20.0, 4001)
    cos, sin = np.empty_like(angles), np.empty_like(angles)
    kernel_of(ALL_MEMBERS[0])._cos_sin(angles, cos, sin)
    np.testing.assert_allclose([cos, sin], [np.cos(angles), np.sin(angles)], rtol=0.0, atol=1e-14)


@pytest.mark.peer
@pytest.mark.timeout(0)
@pytest.mark.parametrize("apart", [1.0, 1e-2, 1e-4])
def test_compiled_covariances_are_those_by_qr_where_columns_are_nearly_alike(apart):
    columns = np.random.default_rng(5).standard_normal((2, 4, 30)) * [[[1.0], [1e3], [1e-3], [1.0]]]
    columns[:, 3] = columns[:, 0] + apart * columns[:, 3]
    found, regular = kernel_of(ALL_MEMBERS[0]).covariances(columns)
    wanted = information.covariance(columns.swapaxes(1, 2))
    std = np.sqrt(np.diagonal(wanted, axis1=1, axis2=2))
    off = found - wanted
    np.testing.assert_allclose(off / (std[:, :, None] * std[:, None]), 0.0, atol=1e-9)
    assert regular.all()
    columns[0, 3] = columns[0, 0]
    assert kernel_of(ALL_MEMBERS[0]).covariances(columns)[-1].tolist() == [False, True]


@pytest.mark.peer
@pytest.mark.timeout(0)
def test_compiled_weights_of_points_are_those_by_numpy_and_need_points():
    _, points_mm = inputs_of(ALL_MEMBERS[0], Estimator.POINTS)
    instrument = replace(INSTRUMENT, robot_scatter_mm=0.02)
    of_instrument = [getattr(instrument, name) for name in WEIGHING]
    weighed_points = kernel_of(ALL_MEMBERS[0]).weighed_points
    by_component, covariance, whitening, is_regular = weighed_points(points_mm, *of_instrument)
    wanted = tracker_noise.point_covariance_mm2(points_mm, instrument)
    np.testing.assert_array_equal(by_component.swapaxes(1, 2), points_mm)
    np.testing.assert_allclose(covariance, wanted, rtol=1e-12, atol=1e-16)
    roots = np.moveaxis(whitening, -1, 1)
    np.testing.assert_allclose(roots, tracker_noise.inverse_roots(wanted), rtol=1e-9, atol=1e-9)
    assert is_regular
    points_mm[2, 3] = 0.0
    assert not weighed_points(points_mm, *of_instrument)[-1]
