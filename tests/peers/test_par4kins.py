"""Our kinematics module, as LinuxCNC loads it, against our model."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from linuxcnc_bench import NOMINAL, compiled_kinematics
from par4_space import par4

from campaigns.controllers.linuxcnc_export import PIN_OF

pytestmark = [
    pytest.mark.peer,
    pytest.mark.skipif(
        shutil.which("halcompile") is None or shutil.which("gcc") is None,
        reason="halcompile (linuxcnc-uspace-dev) or gcc is not installed",
    ),
]

STUB = Path(__file__).with_name("hal_stub.c")
POSES = 1000
SAME_DEG = 1e-6
SAME_MM = 1e-6
LOW = np.array([-520.0, -550.0, -990.0, -np.pi / 4])
HIGH = np.array([520.0, 450.0, -270.0, np.pi / 4])
BEYOND_MM = 400.0


class WorldPose(ctypes.Structure):
    """LinuxCNC's EmcPose."""

    _fields_ = [(letter, ctypes.c_double) for letter in "xyzabcuvw"]


class Module:
    """par4kins.so with HAL functions of our own under it."""

    def __init__(self, folder):
        stub = folder / "stub.so"
        subprocess.run(["gcc", "-shared", "-fPIC", "-o", stub, STUB], check=True)
        self._hal = ctypes.CDLL(str(stub), mode=ctypes.RTLD_GLOBAL)
        self._hal.stub_set.argtypes = [ctypes.c_char_p, ctypes.c_double]
        self._module = ctypes.CDLL(str(compiled_kinematics(folder)))
        assert self._module.rtapi_app_main() == 0

    @property
    def pin_count(self):
        return self._hal.stub_count()

    def set_pins(self, flat):
        for name, value in flat.items():
            assert self._hal.stub_set(PIN_OF[name].encode(), value) == 0, name

    def inverse(self, pose):
        """Joints in deg of X, Y, Z in mm and C in deg; None when refused."""
        world = WorldPose(pose[0], pose[1], pose[2], 0.0, 0.0, pose[3], 0.0, 0.0, 0.0)
        joints = (ctypes.c_double * 4)()
        refused = self._module.kinematicsInverse(ctypes.byref(world), joints, None, None)
        return None if refused else np.array(joints)

    def forward(self, joints_deg, near=(0.0, 0.0, 0.0, 0.0)):
        """X, Y, Z in mm and C in deg, found from `near`; None when refused."""
        world = WorldPose(near[0], near[1], near[2], 0.0, 0.0, near[3], 0.0, 0.0, 0.0)
        joints = (ctypes.c_double * 4)(*joints_deg)
        if self._module.kinematicsForward(joints, ctypes.byref(world), None, None):
            return None
        return np.array([world.x, world.y, world.z, world.c])


@pytest.fixture(scope="module")
def module(tmp_path_factory):
    return Module(tmp_path_factory.mktemp("par4kins"))


@pytest.fixture(scope="module")
def robot():
    """A robot with errors of manufacture in all 29 parameters, and poses that it reaches."""
    draw = np.random.default_rng(5)
    flat = {
        name: value + draw.normal(0.0, 0.5 if name.endswith("mm") else 0.2)
        for name, value in NOMINAL.geometry_flat().items()
    }
    poses = draw.uniform(LOW, HIGH, (5 * POSES, 4))
    geometry = par4(flat)
    return flat, poses[geometry.feasibility(NOMINAL.limits, poses).feasible][:POSES]


def in_degrees(poses):
    return poses * [1.0, 1.0, 1.0, 180.0 / np.pi]


def test_module_has_a_pin_for_every_parameter(module):
    assert module.pin_count == len(PIN_OF) == 29


def test_inverse_is_our_models_on_a_thousand_poses(module, robot):
    flat, poses = robot
    module.set_pins(flat)
    ours_deg = np.degrees(par4(flat).inverse(poses).values_or_raise())
    theirs_deg = np.array([module.inverse(pose) for pose in in_degrees(poses)])
    assert len(poses) == POSES
    assert np.abs(theirs_deg - ours_deg).max() <= SAME_DEG


def test_forward_finds_every_pose_again_from_far_and_from_near(module, robot):
    flat, poses = robot
    module.set_pins(flat)
    joints_deg = np.degrees(par4(flat).inverse(poses).values_or_raise())
    wanted = in_degrees(poses)
    far = np.array([module.forward(joints) for joints in joints_deg])
    near = np.array([module.forward(j, p + 1.0) for j, p in zip(joints_deg, wanted, strict=True)])
    assert np.abs(far - wanted).max() <= SAME_MM
    assert np.abs(near - wanted).max() <= SAME_MM


def test_forward_from_the_wrong_assembly_ends_on_the_right_one(module, robot):
    flat, poses = robot
    module.set_pins(flat)
    joints_deg = np.degrees(par4(flat).inverse(poses[:100]).values_or_raise())
    above = in_degrees(poses[:100]) + np.array([0.0, 0.0, 60.0, 100.0])
    found = np.array([module.forward(j, p) for j, p in zip(joints_deg, above, strict=True)])
    assert np.abs(found - in_degrees(poses[:100])).max() <= SAME_MM


def test_pose_out_of_reach_is_refused(module, robot):
    module.set_pins(robot[0])
    assert module.inverse((0.0, 0.0, -2000.0, 0.0)) is None
    assert module.inverse((0.0, 0.0, -575.0, 95.0)) is None


def test_pose_whose_joints_would_carry_the_plate_elsewhere_is_refused(module, robot):
    module.set_pins(robot[0])
    draw = np.random.default_rng(6)
    wide = in_degrees(draw.uniform(LOW - BEYOND_MM, HIGH + BEYOND_MM, (4000, 4)))
    wide[:, 3] = draw.uniform(-89.0, 89.0, len(wide))
    checked = 0
    for pose in wide:
        joints_deg = module.inverse(pose)
        if joints_deg is not None:
            assert module.forward(joints_deg, pose) == pytest.approx(pose, abs=1e-5)
            checked += 1
    assert checked > 200


def test_joints_without_an_assembly_are_refused(module, robot):
    module.set_pins(robot[0] | {f"arm{arm}.forearm_mm": 100.0 for arm in range(4)})
    assert module.forward((0.0, 0.0, 0.0, 0.0)) is None


@pytest.mark.parametrize("value", [0.0, -100.0, float("nan"), float("inf")])
def test_parameters_that_are_no_robots_refuse_everything(module, robot, value):
    module.set_pins(robot[0] | {"plate_mm": value})
    assert module.inverse((0.0, 0.0, -575.0, 0.0)) is None
    assert module.forward((20.0, 20.0, 20.0, 20.0)) is None
