"""A platform that turns takes along a reflector beside its point, in all that compares points.

The points are by SciPy's rotations, the legs by their lengths.
"""

from dataclasses import replace

import numpy as np
import pytest
from any_axes import PLACE_MM, TRACKER_FROM_BASE, robot_file
from scipy.spatial.transform import Rotation

from campaigns.evaluation.plausibility import check_distances
from campaigns.journal.records import Outcome
from campaigns.measuring.monitors import fit_place
from campaigns.measuring.reference_poses import _tracker_from_base
from campaigns.robots.robot import read_robot
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import shots_of_outcomes
from drivers.values import Pose, vector

REFLECTOR_MM = (120.0, -30.0, -40.0)
SHOTS = 30


@pytest.fixture
def measured(tmp_path):
    """Model of a hexapod, and perfect shots of it."""
    robot = read_robot(robot_file(tmp_path, "hexapod")).robot
    model = robot.kinematics
    model = replace(model, mechanism=model.mechanism.placed(model.p, None, REFLECTOR_MM))
    rng, home = np.random.default_rng(3), robot.workspace_centre
    away = rng.uniform(-1.0, 1.0, (SHOTS, 6)) * [80.0, 80.0, 60.0, 0.2, 0.2, 0.3]
    poses = home + away
    at = poses[:, :3] + Rotation.from_rotvec(poses[:, 3:]).apply(REFLECTOR_MM)
    points = TRACKER_FROM_BASE.apply(at - PLACE_MM)
    joints = model.inverse(poses).values_or_raise()
    shots = [
        Outcome(number, 1, tuple(q), vector(point), None, None, "", "", None)
        for number, (q, point) in enumerate(zip(joints.tolist(), points, strict=True))
    ]
    return model, poses, shots


def test_no_shot_of_it_is_far_from_where_the_robot_puts_it(measured):
    model, poses, outcomes = measured
    targets = [Pose(*pose[:3], rotation_rad=tuple(pose[3:])) for pose in poses.tolist()]
    shots = shots_of_outcomes(
        outcomes, model.mechanism, purposes=[ShotSet.VALIDATION] * SHOTS, pairs=[None] * SHOTS,
        targets=targets,
    )  # fmt: skip
    check_distances(model, shots, 0.01, "series 1")


def test_the_tracker_s_place_and_axes_are_those_of_its_points(measured):
    model, _, outcomes = measured
    place_mm, _ = fit_place(model, outcomes)
    assert place_mm == pytest.approx(tuple(PLACE_MM), abs=1e-3)
    assert _tracker_from_base(model, outcomes) == pytest.approx(
        TRACKER_FROM_BASE.as_matrix(), abs=1e-6
    )
