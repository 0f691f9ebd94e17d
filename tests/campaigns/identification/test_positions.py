"""σ of positions and its budget, against differences of positions, the frame fitted by rows."""

from dataclasses import replace

import numpy as np
import pytest
from small_fits import model_of, observed

from campaigns.design.pose_sampling import workspace_poses
from campaigns.fit.effects import Layer, Ripple
from campaigns.fit.error_model import Observations
from campaigns.fit.fit import fit_model, integrate_sizes, refit
from campaigns.identification.positions import std_of_positions, uncertainty_of_positions
from campaigns.identification.result import ParameterCovariance, Uncertainty
from campaigns.robots.robot import find_robot

GROUPS = ("offsets", "lengths", "axes", "sag")
FAR = [5, 9]
"""Shots that do not count."""


def sample_of(count, seed=5, name="delta"):
    robot = find_robot(name).robot
    rng = np.random.default_rng(seed)
    return workspace_poses(robot.kinematics, robot.limits, robot.workspace_centre, count, rng)


@pytest.fixture(scope="module")
def fit():
    """Fit of shots near the centre, without two that are far from it."""
    model = model_of("delta", *GROUPS)
    many = observed(model, 120, noise_mm=0.1)
    apart = np.linalg.norm(many.near[:, :3] - many.near[:, :3].mean(axis=0), axis=1)
    nearest = np.argsort(apart)
    rows = nearest[:24].copy()
    rows[FAR] = nearest[-2:]
    shots = many.rows(rows)
    moments = np.arange(24.0)
    fit = fit_model(model, replace(shots, moment=moments, former=shots.joints))
    good = fit.good.copy()
    good[FAR] = 0.0
    return replace(fit, good=good)


def with_plate_that_turns():
    model = model_of("par4-prototype", "offsets", "lengths")
    return fit_model(model, observed(model))


def identified(fit):
    return fit.model.kinematics(fit.x)


def differences(change, at, step):
    """Central differences (N, 3, Q) of what `change` returns (N, 3) by each entry of `at`."""
    columns = []
    for place in range(len(at)):
        off = step * (np.arange(len(at)) == place)
        columns.append((change(at + off) - change(at - off)) / (2.0 * step))
    return np.stack(columns, axis=2)


def by_unknowns(fit, joints, near):
    """Derivatives (N, 3, P) of the positions of the identified robot by its unknowns."""

    def positions(x):
        return fit.model.kinematics(x).forward(joints, near).values_or_raise()[:, :3]

    return differences(positions, fit.x, 1e-3)


def by_joints(fit, joints, near):
    """Derivatives (N, 3, n) of the positions of the identified robot by its joints."""

    def positions(shift):
        return identified(fit).forward(joints + shift, near).values_or_raise()[:, :3]

    return differences(positions, np.zeros(joints.shape[1]), 1e-5)


def placed(by, positions):
    """Derivatives (N, 3, Q) after the motion of the frame that fits each of them best."""
    turns = [np.cross(axis, positions) for axis in np.eye(3)]
    shifts = [np.broadcast_to(axis, positions.shape) for axis in np.eye(3)]
    motions = np.stack([*turns, *shifts], axis=2).reshape(-1, 6)
    rows = by.reshape(-1, by.shape[2])
    return (rows - motions @ np.linalg.lstsq(motions, rows)[0]).reshape(by.shape)


def variances(by, covariance):
    return np.array([np.trace(of_pose @ covariance @ of_pose.T) for of_pose in by])


def parts(fit, workspace):
    """Joints and poses of the workspace, its placed derivatives and variances by unknowns."""
    joints = identified(fit).inverse(workspace).values_or_raise()
    by = placed(by_unknowns(fit, joints, workspace), workspace[:, :3])
    return joints, by, variances(by, fit.model_covariance)


def rows_of(positions):
    return {share.source: share.mm**2 for share in positions.budget}


def total(positions):
    return sum(rows_of(positions).values())


def judge_sample(fit, workspace):
    """σ of the sample's positions, by their own derivatives; return what was found."""
    found = uncertainty_of_positions(fit, identified(fit), workspace, 1.0)
    std = np.sqrt(parts(fit, workspace)[2])
    assert found.position_std_mm.mean == pytest.approx(std.mean(), rel=1e-3)
    assert found.position_std_mm.max == pytest.approx(std.max(), rel=1e-3)
    assert found.position_std_mm.rms == pytest.approx(np.sqrt((std**2).mean()), rel=1e-3)
    assert (found.position_std_mm.left_out, found.position_std_mm.corrected) == (0, None)
    assert total(found) == pytest.approx(found.position_std_mm.rms**2)
    return found


def test_sigma_is_that_of_differences_of_positions_in_the_frame_that_fits_them_best(fit):
    found = judge_sample(fit, sample_of(20))
    assert {"repeating", "model", "layer"}.isdisjoint(rows_of(found))
    kinds = {share.source: share.kind for share in found.budget}
    assert kinds["stated"] == kinds["offsets"] == kinds["sag"] == "B"
    assert kinds["points"] == kinds["joints"] == "A"


def test_a_robot_that_turns_its_plate_is_judged_by_positions_alone():
    judge_sample(with_plate_that_turns(), sample_of(12, name="par4-prototype"))


def test_scatter_that_repeats_is_an_error_of_the_point_and_by_the_joints(fit):
    workspace = sample_of(20)
    joints = parts(fit, workspace)[0]
    by_joint = by_joints(fit, joints, workspace)
    for point, of_joints in ((0.6, 1e-6), (1e-4, 0.8)):
        scattered = replace(fit, factors={**fit.factors, "points": point, "joints": of_joints})
        s_point, s_joint = scattered.scatter
        expected = 0.3 * (3.0 * s_point**2 + s_joint**2 * (by_joint**2).sum(axis=(1, 2)))
        alone = uncertainty_of_positions(scattered, identified(fit), workspace, 1.0)
        found = uncertainty_of_positions(scattered, identified(fit), workspace, 1.0, 0.3)
        assert rows_of(found)["repeating"] == pytest.approx(expected.mean(), rel=1e-4)
        variance = parts(scattered, workspace)[2] + expected
        assert found.position_std_mm.max == pytest.approx(np.sqrt(variance.max()), rel=1e-4)
        assert total(found) == pytest.approx(found.position_std_mm.rms**2)
        assert total(found) - total(alone) == pytest.approx(expected.mean(), rel=1e-4)
    (row,) = [share for share in found.budget if share.source == "repeating"]
    assert row.kind == "A"


def test_errors_that_pairs_show_widen_sigma_by_their_ratio_and_have_a_row(fit):
    workspace = sample_of(20)
    alone = uncertainty_of_positions(fit, identified(fit), workspace, 1.0, 0.3)
    wide = uncertainty_of_positions(fit, identified(fit), workspace, 3.0, 0.3)
    for name in ("mean", "max", "rms"):
        assert getattr(wide.position_std_mm, name) == pytest.approx(
            3.0 * getattr(alone.position_std_mm, name)
        )
    assert rows_of(wide)["model"] == pytest.approx((9.0 - 1.0) * alone.position_std_mm.rms**2)
    assert total(wide) == pytest.approx(wide.position_std_mm.rms**2)
    assert wide.budget[-1].kind == "A"


def with_moved(fit, effect, z):
    """The fit with an effect whose unknowns have these values."""
    with_effect = refit(fit, fit.model.with_effects((effect,)))
    x = np.r_[with_effect.at.x[: -effect.count], z]
    return replace(with_effect, at=replace(with_effect.at, x=x), good=fit.good)


def test_what_a_layer_moves_is_an_error_of_parameters_and_none_of_who_follows_it(fit):
    workspace, shots = sample_of(20), fit.observations
    layer = Layer.over("place", (shots.near[:, :3],), 300.0, 0.05)
    z = np.random.default_rng(3).standard_normal(layer.count)
    layered = with_moved(fit, layer, z)
    joints = identified(layered).inverse(workspace).values_or_raise()
    here = Observations.unmeasured(joints, workspace)
    moved = placed((layer.basis(here) @ z)[:, :, None], workspace[:, :3])
    by = np.concatenate([by_unknowns(layered, joints, workspace), layer.basis(here)], axis=2)
    size = layered.model.size
    followed = variances(placed(by, workspace[:, :3]), layered.covariance[:size, :size])
    sizes = [layer.usual * layered.sizes[group] for group, _ in layer.sizes_of]
    followed += (np.square(sizes) * layer.unseen_share(here)).sum(axis=1)
    variance = 4.0 * (followed + (moved**2).sum(axis=(1, 2)))
    found = uncertainty_of_positions(layered, identified(layered), workspace, 2.0)
    assert found.position_std_mm.corrected == pytest.approx(
        2.0 * np.sqrt(followed.mean()), rel=1e-3
    )
    assert found.position_std_mm.rms == pytest.approx(np.sqrt(variance.mean()), rel=1e-3)
    assert found.position_std_mm.max == pytest.approx(np.sqrt(variance.max()), rel=1e-3)
    assert total(found) == pytest.approx(found.position_std_mm.rms**2)
    still = with_moved(fit, layer, 0.0 * z)
    without = uncertainty_of_positions(still, identified(layered), workspace, 2.0)
    assert without.position_std_mm.corrected is None
    difference = rows_of(found)["layer"] - rows_of(without).get("layer", 0.0)
    unseen = (np.square(sizes) * layer.unseen_share(here)).sum(axis=1).mean()
    assert difference == pytest.approx((moved**2).sum() / 20 + unseen, rel=0.02)


def test_a_ripple_beyond_those_of_the_robot_file_is_an_error_with_correct_too(fit):
    workspace = sample_of(20)
    ripple = Ripple((1,), 40.0, 0.5, 1e-4, -8.0)
    rippled = with_moved(fit, ripple, np.array([6.0, -2.0, 0.0]))
    joints = identified(rippled).inverse(workspace).values_or_raise()
    angle = 40.0 * joints[:, 1]
    wave = 1e-4 * (6.0 * np.sin(angle) - 2.0 * np.cos(angle))
    moved = by_joints(rippled, joints, workspace)[..., 1:2] * wave[:, None, None]
    beyond = (placed(moved, workspace[:, :3]) ** 2).sum(axis=(1, 2))
    found = uncertainty_of_positions(rippled, identified(rippled), workspace, 1.0)
    without = with_moved(fit, ripple, np.zeros(3))
    alone = uncertainty_of_positions(without, identified(rippled), workspace, 1.0)
    gap = found.position_std_mm.rms**2 - alone.position_std_mm.rms**2
    assert gap == pytest.approx(beyond.mean(), rel=0.02)
    assert rows_of(found)["layer"] == pytest.approx(gap, rel=0.02)
    assert found.position_std_mm.corrected == pytest.approx(found.position_std_mm.rms)


def test_the_region_ends_where_sigma_is_three_times_the_largest_at_shots_that_counted(fit):
    workspace, shots = sample_of(60), fit.observations.rows(fit.kept)
    joints = np.vstack([identified(fit).inverse(workspace).values_or_raise(), shots.joints])
    near = np.vstack([workspace, shots.near])
    places = identified(fit).forward(joints, near).values_or_raise()[:, :3]
    by_point, by_joint = fit.scatter
    repeats = by_point**2 * 3.0 + by_joint**2 * (by_joints(fit, joints, near) ** 2).sum(axis=(1, 2))
    of_unknowns = variances(placed(by_unknowns(fit, joints, near), places), fit.model_covariance)
    beyond = []
    for share in (0.0, 0.5):
        found = uncertainty_of_positions(fit, identified(fit), workspace, 1.0, share)
        std = np.sqrt(of_unknowns + share * repeats)
        expected = np.mean(std[:60] > 3.0 * std[60:].max())
        assert found.region.beyond == pytest.approx(expected)
        beyond.append(expected)
    assert 0.0 < beyond[1] < beyond[0] < 1.0


def test_places_between_the_shots_of_a_layer_are_beyond_the_region(fit):
    workspace, shots = sample_of(40), fit.observations.rows(fit.kept)
    layer = Layer.over("place", (fit.observations.near[:, :3],), 40.0, 0.5)
    layered = with_moved(fit, layer, np.zeros(layer.count))
    layered = replace(layered, sizes={**layered.sizes, **dict.fromkeys(layered.groups, 1.0)})
    joints = np.vstack([identified(layered).inverse(workspace).values_or_raise(), shots.joints])
    near = np.vstack([workspace, shots.near])
    places, here = near[:, :3], Observations.unmeasured(joints, near)
    by = np.concatenate([by_unknowns(layered, joints, near), layer.basis(here)], axis=2)
    size = layered.model.size
    followed = variances(placed(by, places), layered.covariance[:size, :size])
    sizes = [layer.usual * layered.sizes[group] for group, _ in layer.sizes_of]
    std = np.sqrt(followed + (np.square(sizes) * layer.unseen_share(here)).sum(axis=1))
    expected = np.mean(std[:40] > 3.0 * std[40:].max())
    found = uncertainty_of_positions(layered, identified(layered), workspace, 1.0)
    assert found.region.beyond == pytest.approx(expected)
    assert expected > np.mean(np.sqrt(followed[:40]) > 3.0 * np.sqrt(followed[40:]).max())


def test_nine_of_ten_poses_must_be_within_reach_and_lost_ones_are_counted(fit):
    workspace = sample_of(10)
    far = workspace.copy()
    far[3, :3] += 5000.0
    found = uncertainty_of_positions(fit, identified(fit), far, 1.0)
    others = uncertainty_of_positions(fit, identified(fit), np.delete(workspace, 3, axis=0), 1.0)
    assert found.position_std_mm.left_out == 1
    assert found.position_std_mm == replace(others.position_std_mm, left_out=1)
    far[7, :3] += 5000.0
    assert uncertainty_of_positions(fit, identified(fit), far, 1.0) == Uncertainty()


def test_what_sizes_may_be_counts_in_sigma_and_budget(fit):
    workspace = sample_of(20)
    averaged = replace(integrate_sizes(fit), good=fit.good)
    found = uncertainty_of_positions(averaged, identified(averaged), workspace, 1.0)
    variance = parts(averaged, workspace)[2]
    assert found.position_std_mm.rms == pytest.approx(np.sqrt(variance.mean()), rel=1e-3)
    assert total(found) == pytest.approx(found.position_std_mm.rms**2)


@pytest.mark.parametrize("turns", [False, True])
def test_stored_covariances_give_the_same_sigma_about_the_poses_that_were_measured(fit, turns):
    fit, name = (with_plate_that_turns(), "par4-prototype") if turns else (fit, "delta")
    table = fit.model.nominal.mechanism.parameters
    names = tuple(fit.model.names[: len(fit.model.parameters)])
    names = tuple(name for name in names if name in table.select())
    rows = [fit.model.names.index(name) for name in names]
    units = fit.model.tolerance[rows] / table.file_unit[table.places(names)]
    stored = fit.model_covariance[np.ix_(rows, rows)] * np.outer(units, units)
    covariance = ParameterCovariance(names, tuple(map(tuple, stored.tolist())), 2.5)
    workspace, about = sample_of(8, name=name), sample_of(25, 6, name)
    both = np.vstack([workspace, about])
    joints = identified(fit).inverse(both).values_or_raise()
    by = placed(by_unknowns(fit, joints, both), both[:, :3])[..., rows]
    expected = variances(by, fit.model_covariance[np.ix_(rows, rows)])
    found = std_of_positions(identified(fit), covariance, workspace, about)
    assert found == pytest.approx(2.5 * np.sqrt(expected[:8]), rel=1e-3)
