import numpy as np
import pytest
from family_cases import PAR4_REFERENCE, flat_in
from par4_space import SPACE, par4

from benchmarks.against_rivals import by_differences
from benchmarks.rivals import lab_script
from benchmarks.shared.measured_robot import MeasuredRobot, measured_robot, printed_parameters
from benchmarks.shared.prototype import NOMINAL
from campaigns.estimation.least_squares import solve
from campaigns.estimation.residuals import DistanceResiduals, PositionModel

SHOTS = 16
FREE = SPACE.places(("arm1.joint_offset_deg", "arm2.forearm_mm", "plate_mm"))
COMMANDED_OFF = np.array([5.0, -5.0, 5.0, 0.02])
"""As far as a robot with errors is from where it was sent."""


@pytest.fixture(scope="module")
def robot():
    whole = measured_robot()
    return MeasuredRobot(whole.joints[:SHOTS], whole.points_mm[:SHOTS], whole.commanded[:SHOTS])


@pytest.fixture(scope="module")
def problem(robot):
    model = PositionModel(NOMINAL, FREE, robot.joints)
    return DistanceResiduals.in_mm(model, *robot.pairs.T, robot.measured_mm())


def test_the_lab_script_finds_the_parameters_that_we_find(robot, problem):
    data = robot.joints, robot.commanded, robot.pairs, robot.measured_mm()
    theirs = lab_script.identify(printed_parameters(NOMINAL), FREE, *data)
    assert theirs == pytest.approx(solve(problem).x, abs=1e-4)
    assert abs(theirs - problem.start()).max() > 0.1, "the start is not the answer"


def test_scipy_by_differences_finds_the_parameters_that_we_find(problem):
    assert by_differences(problem) == pytest.approx(solve(problem).x, abs=1e-4)


def test_the_lab_script_takes_the_golden_joints_to_the_golden_poses():
    case = PAR4_REFERENCE["cases"]["nominal+table1"]
    vector = printed_parameters(par4(flat_in(case["geometry"])))
    for pose in case["poses"][:20]:
        x_mm, y_mm, z_mm, theta_deg = (pose[k] for k in ("x_mm", "y_mm", "z_mm", "theta_deg"))
        golden = np.array([x_mm, y_mm, z_mm, np.radians(theta_deg)])
        found = lab_script.forward(vector, np.radians(pose["joints_deg"]), golden + COMMANDED_OFF)
        assert found == pytest.approx(golden, abs=1e-5)
