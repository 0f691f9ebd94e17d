"""A robot with joints that turn and joints that slide: each by its own unit."""

import numpy as np
import pytest
from any_axes import robot_file

from campaigns.evaluation.robot_scatter import RobotScatter
from campaigns.fit import events, periods
from campaigns.fit.error_model import ErrorModel, Observations
from campaigns.fit.error_sources import ARCMIN, scatter_tolerances
from campaigns.fit.fit import fit_model, noise_parts
from campaigns.fit.layers import candidate_layers
from campaigns.identification.findings import scatter_in_words
from campaigns.robots.robot import read_robot
from campaigns.shots.shots import shots_of_rows
from campaigns.shots.shots_csv import parse_shots

TOLERANCES = np.array([5 * ARCMIN, 0.1, 0.1])


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("polar")


@pytest.fixture(scope="module")
def robot(folder):
    return read_robot(robot_file(folder, "polar")).robot


@pytest.fixture(scope="module")
def joints(robot):
    rng = np.random.default_rng(5)
    poses = [300.0, 0.0, 0.0] + rng.uniform(-1.0, 1.0, (30, 3)) * [90.0, 200.0, 200.0]
    return robot.kinematics.inverse(poses).values_or_raise()


@pytest.fixture(scope="module")
def fit(robot, joints):
    poses = robot.kinematics.forward(joints).values
    points = poses + np.random.default_rng(6).normal(0.0, 0.01, poses.shape) + [2000.0, 0.0, 0.0]
    stated = {"stated": np.tile(1e-4 * np.eye(3), (30, 1, 1))}
    observations = Observations.unmeasured(joints, poses)
    observations = Observations(
        **{name: getattr(observations, name) for name in Observations.__slots__}
        | {"points": points, "noise": stated}
    )
    return fit_model(ErrorModel(robot.kinematics), observations)


def test_scatter_has_a_tolerance_of_each_kind(robot, fit):
    assert scatter_tolerances(robot.mechanism.joints).tolist() == TOLERANCES.tolist()
    parts = noise_parts(fit.model, fit.observations, fit.at.by_joint)
    variances = np.diag(TOLERANCES**2)
    wanted = fit.at.by_joint @ variances @ fit.at.by_joint.swapaxes(1, 2)
    np.testing.assert_allclose(parts["joints"], wanted)
    assert fit.joint_scatters / fit.joint_scatters[0] == pytest.approx(TOLERANCES / TOLERANCES[0])
    turning, sliding = scatter_in_words(fit).split(" and ")
    assert turning == f"{fit.scatter[1] / ARCMIN:.2g}′"
    assert sliding == f"{fit.joint_scatters[1]:.2g} mm"


def test_scatter_of_a_result_spreads_points_by_each_joints_own(robot, joints):
    columns = [axis.column for axis in robot.mechanism.joints]
    lines = [",".join(["pair", *columns, "x_mm,y_mm,z_mm"])]
    for shot, row in enumerate(joints.tolist()):
        cells = [axis.to_file(q) for axis, q in zip(robot.mechanism.joints, row, strict=True)]
        lines.append(",".join(map(str, [shot // 2, *cells, *row])))
    rows = parse_shots("\n".join(lines), "f.csv", robot.mechanism)
    shots = shots_of_rows(rows, robot.kinematics)
    scatter = RobotScatter.identified(0.0, 1.0 / 60.0, 30, robot.kinematics)
    by_joint = robot.kinematics.joint_jacobian(shots.joints, shots.commanded)[:, :3]
    variances = np.diag((ARCMIN * TOLERANCES / TOLERANCES[0]) ** 2)
    wanted = by_joint @ variances @ by_joint.swapaxes(1, 2)
    np.testing.assert_allclose(scatter.covariance_mm2(shots), wanted, atol=1e-12)


def test_only_encoders_of_joints_that_turn_change_by_angles(robot):
    mechanism = robot.mechanism
    of_parts = {
        part: events.changes_by_angle(part, mechanism.joints)
        for part in ("encoder 0", "encoder 1", "arm 0", "frame")
    }
    assert of_parts == {"encoder 0": True, "encoder 1": False, "arm 0": False, "frame": False}
    assert mechanism.travel(0.01).tolist() == [0.01, 3.0, 3.0]


def test_drives_without_ripples_have_no_periods_and_unlike_joints_no_layer_of_arms(fit):
    assert fit.model.nominal.mechanism.rippling.tolist() == []
    assert len(periods.scan_periods(fit).rates) == 0
    assert list(periods.likely_ripples(fit)) == []
    assert {layer.kind for layer in candidate_layers(fit)} == {"place"}
