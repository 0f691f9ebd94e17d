"""What shots determine: rotation with its σ, the share of tolerances, and what a pass needs."""

import numpy as np
import pytest
from rod_campaigns import SMALL, rod_campaign
from scipy.spatial.transform import Rotation

from campaigns.api import find_robot, identify, sample_workspace
from campaigns.errors import OptionsInvalid
from campaigns.identification.determined import Determined, quantity_findings
from campaigns.identification.options import IdentificationOptions
from campaigns.identification.positions import std_of_rotations
from campaigns.identification.result import ParameterCovariance
from campaigns.kinematics.model import Kinematics


def rotations(robot, joints, poses):
    """Rotations of the tool: of the plate's tilt, after its turn about z or its rotation vector."""
    size = len(robot.mechanism.task)
    unknowns = robot.mechanism.assemble(robot.p, joints, poses).unknowns
    turns = np.zeros((len(joints), 3))
    turns[:, 6 - size :] = unknowns[:, 3:size]
    tilt = np.zeros((len(joints), 3))
    tilt[:, : unknowns.shape[1] - size] = unknowns[:, size:]
    return Rotation.from_rotvec(tilt) * Rotation.from_rotvec(turns)


def without_conventions(turns, axes):
    """Turns (N, 3) less the turns of base and tool that explain most of them."""
    motions = np.concatenate([np.broadcast_to(np.eye(3), axes.shape), axes], axis=2)
    columns = motions.reshape(-1, 6)
    explained = columns @ np.linalg.lstsq(columns, turns.ravel(), rcond=1e-6)[0]
    return (turns.ravel() - explained).reshape(-1, 3)


NAMES = {
    "hexapod": ("arm0.plate_x_mm", "arm3.y_mm", "arm5.joint_offset_mm"),
    "par4-prototype": ("arm1.axis_tilt_deg", "arm2.arm_mm", "plate_mm"),
}


@pytest.mark.parametrize("name", NAMES)
def test_sigma_of_rotation_is_that_of_drawn_robots_up_to_the_axes_of_base_and_tool(name):
    robot = find_robot(name)
    nominal, std = robot.kinematics, np.array([0.05, 0.03, 0.04])
    covariance = ParameterCovariance(NAMES[name], tuple(map(tuple, np.diag(std**2).tolist())))
    poses = sample_workspace(robot, 30, seed=2)
    joints = nominal.inverse(poses).values_or_raise()
    places = nominal.mechanism.parameters.places(NAMES[name])
    units = nominal.mechanism.parameters.file_unit[places]
    axes, at_nominal = rotations(nominal, joints, poses), nominal.whole_p
    squares = np.zeros(len(poses))
    for place, unit, size in zip(places, units, std, strict=True):
        step = np.zeros(len(at_nominal))
        step[place] = 0.5e-2 * size * unit
        larger, smaller = (
            rotations(Kinematics(nominal.mechanism, at_nominal + sign * step), joints, poses)
            for sign in (1.0, -1.0)
        )
        turned = 1e2 * (larger * smaller.inv()).as_rotvec()
        rest = without_conventions(turned, axes.as_matrix())
        squares += (np.degrees(rest) ** 2).sum(axis=1)
    found = std_of_rotations(nominal, covariance, poses, poses)
    assert found == pytest.approx(np.sqrt(squares), rel=1e-5)


@pytest.fixture(scope="module")
def par4():
    return rod_campaign("par4-prototype", SMALL, shots=40, pairs=8, seed=4)


def test_rotation_that_one_reflector_cannot_test_is_not_passed(par4):
    asked = {"quantities": ("position,rotation",)}
    result = identify(par4.shots, par4.robot, options=asked)
    position, rotation = result.uncertainty.determined
    assert (position.name, position.is_determined, position.is_tested) == ("position", True, True)
    assert position.rms == result.uncertainty.position_std_mm.rms
    assert not rotation.is_tested
    assert 0.0 < rotation.mean <= rotation.rms <= rotation.max < 1.0
    assert {"not-tested", "not-determined"} & {*result.judgement.obstacles}
    assert result.judgement.verdict == "not decided"
    assert identify(par4.shots, par4.robot).judgement.verdict == "pass"


def test_positions_that_rest_on_tolerances_are_not_determined(par4):
    rows = np.r_[np.arange(6), par4.shots.rows_of(*{par4.shots.purposes[-1]})]
    result = identify(par4.shots.rows(rows), par4.robot)
    position = result.uncertainty.determined[0]
    assert position.assumed > 0.5
    assert "not-determined" in result.judgement.obstacles


def test_a_quantity_needs_to_be_determined_tested_and_certain():
    def obstacles(limit=None, wanted=("rotation",), **changed):
        facts = {"assumed": 0.1, "is_tested": True} | changed
        quantity = Determined("rotation", mean=0.01, max=0.03, rms=0.02, **facts)
        return [f.name for f in quantity_findings([quantity], wanted, limit)]

    assert obstacles() == []
    assert obstacles(assumed=0.51) == ["not-determined"]
    assert obstacles(assumed=0.5) == []
    assert obstacles(is_tested=False) == ["not-tested"]
    assert obstacles(is_tested=False, wanted=("position",)) == []
    # U is twice the largest σ
    assert obstacles(limit=0.061) == []
    assert obstacles(limit=0.059) == ["too-uncertain"]


def test_quantities_are_asked_for_with_commas_or_by_a_limit():
    options = IdentificationOptions(quantities=("position, rotation", "rotation"))
    assert options.judged_quantities == ("position", "rotation")
    assert IdentificationOptions().judged_quantities == ("position",)
    assert IdentificationOptions(rotation_deg=0.1).judged_quantities == ("position", "rotation")
    with pytest.raises(OptionsInvalid, match=r"--for turns is no quantity"):
        IdentificationOptions(quantities=("turns",))


def test_rotation_of_a_platform_that_does_not_turn_is_refused():
    campaign = rod_campaign("delta", SMALL, shots=20, pairs=4, seed=1)
    with pytest.raises(OptionsInvalid, match="the platform of a delta does not turn"):
        identify(campaign.shots, campaign.robot, options={"quantities": ("rotation",)})


def test_quantities_on_a_plane_are_in_mm_and_missing_ones_come_in_one_order():
    units = {
        name: Determined(name, 1.0, 1.0, 1.0, 0.0, is_tested=True).unit
        for name in ("flat", "xy", "position", "rotation")
    }
    assert units == {"flat": "mm", "xy": "mm", "position": "mm", "rotation": "deg"}
    missing = quantity_findings([], ("xy", "rotation", "flat"), None)
    names = [finding.says.partition(":")[0] for finding in missing]
    assert names == ["flat", "xy", "rotation"], "what nothing states is not decided"
