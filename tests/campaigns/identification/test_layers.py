"""Errors for which no source has a column: seen, stated for parameters, followed by `correct`."""

import numpy as np
import pytest
from rod_campaigns import SMALL, rod_campaign, with_points

from campaigns.api import correct_targets, identify, sample_workspace
from campaigns.fit.rigid_transforms import fit_transform
from campaigns.identification import findings

BENT_MM = 0.3


def bent_mm(poses):
    """A frame that lifts the plate by a kink: 1 mrad beyond x = 60 mm."""
    return BENT_MM * np.maximum(poses[:, :1] - 60.0, 0.0) / 200.0 * np.array([0.0, 0.0, 1.0])


@pytest.fixture(scope="module")
def kinked():
    campaign = rod_campaign("par4-prototype", SMALL, shots=60, seed=6)
    tracker_from_base = fit_transform(
        campaign.shots.commanded[:, :3], campaign.shots.points_in_tracker_mm
    )
    lifted = bent_mm(campaign.shots.commanded) @ tracker_from_base.rotation.T
    moved = with_points(campaign, campaign.shots.points_in_tracker_mm + lifted)
    options = {"workspace": sample_workspace(campaign.robot, 40)}
    return campaign, identify(moved.shots, campaign.robot, options=options)


def test_a_kink_is_an_error_without_a_known_source_and_no_wrong_shot(kinked):
    _, result = kinked
    (layer,) = [finding for finding in result.judgement.findings if finding.name == findings.LAYER]
    assert layer.decision is None
    assert 0.02 < layer.numbers["mm"] < 0.5
    assert not [event for event in result.judgement.events if event.kind == "wrong shot"]


def test_positions_by_parameters_alone_state_the_error_that_correct_follows(kinked):
    _, result = kinked
    std = result.uncertainty.position_std_mm
    assert std.corrected < std.rms
    assert std.rms**2 == pytest.approx(
        sum(share.mm**2 for share in result.uncertainty.budget), rel=1e-3
    )


def test_corrected_targets_follow_the_kink(kinked):
    campaign, result = kinked
    robot = campaign.robot
    identified = robot.of(robot.mechanism, result.value.flat(), name="found", limits=robot.limits)
    poses = sample_workspace(robot, 60, seed=3)

    def error_mm(layers):
        """Rms error of the real points, kink included, in the frame that fits them best."""
        commanded = correct_targets(poses, identified, robot, layers=layers)
        joints = robot.kinematics.controlled.inverse(commanded).values_or_raise()
        real = identified.kinematics.controlled.forward(joints, poses).values_or_raise()
        points = real[:, :3] + bent_mm(real)
        placed = fit_transform(points, poses[:, :3]).apply(points)
        return float(np.sqrt(((placed - poses[:, :3]) ** 2).sum(axis=1).mean()))

    assert error_mm(result.value.layers) < 0.6 * error_mm(())
