"""Our kinematics module, as LinuxCNC loads it, against our model: all six mechanisms."""

import ctypes
import shutil
import subprocess
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from linuxcnc_bench import compiled_kinematics
from linuxcnc_campaign import tell

from campaigns.controllers.linuxcnc_export import drawing_pins, pin_of
from campaigns.kinematics.model import Kinematics
from campaigns.kinematics.parameters import Role
from campaigns.robots.robot import RobotFile, find_robot

pytestmark = [
    pytest.mark.peer,
    pytest.mark.skipif(
        shutil.which("halcompile") is None or shutil.which("gcc") is None,
        reason="halcompile (linuxcnc-uspace-dev) or gcc is not installed",
    ),
]

STUB = Path(__file__).with_name("hal_stub.c")
ROBOTS = ("par4-prototype", "h4", "i4r", "i4l", "delta", "linear-delta")
POSES = 1000
SAME = 1e-6
"""mm or deg."""
STRAINED = 5e-3
"""The same of four arms with imperfect parts, whose rods cannot all close: the module fits the tilt
alone to them, our model tilt and pose."""
BEYOND = 400.0
SERVO_US = 1000.0


@dataclass(frozen=True)
class Case:
    """A robot with errors of manufacture in all parameters, and poses that it reaches."""

    robot: RobotFile
    poses: np.ndarray
    joints: np.ndarray

    @property
    def kinematics(self) -> Kinematics:
        return self.robot.kinematics

    @property
    def same(self) -> float:
        imperfect = any(name in self.robot.parameters for name in extensions_of(self.robot))
        return STRAINED if imperfect and len(self.robot.mechanism.joints) > 3 else SAME

    def joints_out(self):
        """In deg or mm."""
        return self.joints * scale(self.robot.mechanism.joints)

    def poses_out(self):
        """In mm and deg."""
        return self.poses * scale(self.robot.mechanism.task)


def scale(axes):
    return np.array([axis.to_file(1.0) for axis in axes])


def extensions_of(robot):
    return robot.mechanism.parameters.select(Role.EXTENSION)


def gears_of(space):
    """Names of gears' and encoders' errors that are pins of the module."""
    return [n for n in space.select(Role.TRANSMISSION) if space[n].field.group != "backlash"]


def drawn(name, *, extended, seed=5):
    draw, nominal = np.random.default_rng(seed), find_robot(name).robot
    space = nominal.mechanism.parameters
    flat = {
        key: value + draw.normal(0.0, 0.5 if key.endswith("mm") else 0.2)
        for key, value in nominal.parameters.items()
    }
    if extended:
        flat |= {key: draw.normal(0.0, 0.1) for key in extensions_of(nominal)}
        on_plate = (*space.select(group="plate_joints"), *space.select(group="reflector"))
        flat |= {key: draw.normal(0.0, 5.0) for key in on_plate}
        gears = gears_of(space)
        flat |= {key: draw.normal(0.0, 100.0 if "ppm" in key else 0.01) for key in gears}
        plate = replace(
            nominal.mechanism.plate,
            joints_mm=tuple(
                map(tuple, draw.normal(nominal.mechanism.plate.joints_mm, 5.0).tolist())
            ),
            reflector_mm=(20.0, -30.0, -45.0),
        )
        rate = 30.0 if nominal.mechanism.joints[0].is_revolute else 2.0 * np.pi / 0.2
        drawn = nominal.mechanism.with_plate(plate).with_ripples(rate)
        nominal = replace(nominal, mechanism=drawn)
    robot = RobotFile.of(nominal.mechanism, flat, name=name, limits=nominal.limits)
    model, limits = robot.kinematics, nominal.limits
    kept = np.empty((0, len(nominal.mechanism.task)))
    for _ in range(60):
        found = model.forward(draw.uniform(*limits.joint, (POSES, space.arms)))
        poses = found.values[found.is_solved]
        kept = np.concatenate([kept, poses[model.feasibility(limits, poses).feasible]])[:POSES]
        if len(kept) == POSES:
            break
    assert len(kept) == POSES
    return Case(robot, kept, model.inverse(kept).values_or_raise())


class WorldPose(ctypes.Structure):
    """LinuxCNC's EmcPose."""

    _fields_ = [(letter, ctypes.c_double) for letter in "xyzabcuvw"]


class Module:
    """pkmkins.so of one type with HAL functions of our own under it."""

    def __init__(self, hal, library, kind):
        self._hal, self._kind = hal, kind
        self._module = ctypes.CDLL(str(library))
        ctypes.c_char_p.from_address(
            ctypes.c_void_p.in_dll(self._module, "rtapi_info_address_type").value
        ).value = kind.encode()
        self.started = self._module.rtapi_app_main() == 0
        self._component = hal.stub_component()

    @property
    def pin_count(self):
        return self._hal.stub_count(self._component)

    def set_robot(self, robot):
        """Set all pins as a robot's file and drawing say."""
        space = robot.mechanism.parameters
        names = {*space.of_robot, space.rate.name} - {*space.select(group="backlash")}
        values = dict.fromkeys(names, 0.0) | dict(robot.parameters)
        self.arms, self.turns = len(robot.mechanism.joints), len(robot.mechanism.task) > 3
        self.set_pins({pin_of(name): value for name, value in values.items()})
        self.set_pins(drawing_pins(robot.mechanism))

    def set_pins(self, values):
        for pin, value in values.items():
            assert self._hal.stub_set(self._component, pin.encode(), value) == 0, pin

    def pin(self, name):
        return self._hal.stub_get(self._component, name.encode())

    def inverse(self, pose):
        """Joints in deg or mm of X, Y, Z in mm and C in deg; None when refused."""
        turn = pose[3] if self.turns else 0.0
        world = WorldPose(pose[0], pose[1], pose[2], 0.0, 0.0, turn, 0.0, 0.0, 0.0)
        joints = (ctypes.c_double * 9)()
        refused = self._module.kinematicsInverse(ctypes.byref(world), joints, None, None)
        return None if refused else np.array(joints[: self.arms])

    def forward(self, joints_out, near=(0.0, 0.0, 0.0, 0.0)):
        """X, Y, Z in mm and C in deg, found from `near`; None when refused."""
        turn = near[3] if self.turns else 0.0
        world = WorldPose(near[0], near[1], near[2], 0.0, 0.0, turn, 0.0, 0.0, 0.0)
        joints = (ctypes.c_double * 9)(*joints_out)
        if self._module.kinematicsForward(joints, ctypes.byref(world), None, None):
            return None
        return np.array([world.x, world.y, world.z, world.c][: 3 + self.turns])

    def times_us(self, which, rows):
        """Times of one call each, from rows of poses or joints."""
        padded = np.zeros((len(rows), 9))
        # of EmcPose: X Y Z A B C
        columns = [0, 1, 2, 5] if which == "kinematicsInverse" else [0, 1, 2, 3]
        padded[:, columns[: rows.shape[1]]] = rows
        times = np.zeros(len(rows))
        doubles = ctypes.POINTER(ctypes.c_double)
        self._hal.stub_time(
            ctypes.cast(getattr(self._module, which), ctypes.c_void_p),
            len(rows),
            padded.ctypes.data_as(doubles),
            times.ctypes.data_as(doubles),
        )
        return times


@pytest.fixture(scope="module")
def loaded(tmp_path_factory):
    """What loads the module as one type."""
    folder = tmp_path_factory.mktemp("pkmkins")
    stub = folder / "stub.so"
    subprocess.run(["gcc", "-O2", "-shared", "-fPIC", "-o", stub, STUB], check=True)
    hal = ctypes.CDLL(str(stub), mode=ctypes.RTLD_GLOBAL)
    hal.stub_get.argtypes, hal.stub_get.restype = [ctypes.c_int, ctypes.c_char_p], ctypes.c_double
    hal.stub_set.argtypes = [ctypes.c_int, ctypes.c_char_p, ctypes.c_double]
    compiled = compiled_kinematics()
    modules = {}

    def load(kind):
        if kind not in modules:
            # a copy: the same file is loaded once only
            copy = shutil.copy(compiled, folder / f"{kind}.so")
            modules[kind] = Module(hal, copy, kind)
        return modules[kind]

    return load


@pytest.fixture(scope="module", params=[False, True], ids=["contracted", "full"])
def extended(request):
    return request.param


@pytest.fixture(scope="module", params=ROBOTS)
def case(request, extended):
    return drawn(request.param, extended=extended)


@pytest.fixture
def module(loaded, case):
    module = loaded(case.robot.mechanism.name)
    module.set_robot(case.robot)
    return module


def test_module_has_a_pin_for_every_parameter_and_the_plates_drawing(module, case):
    mechanism = case.robot.mechanism
    space = mechanism.parameters
    of_ini, rate, asking = len(space.select(group="backlash")), 1, module.arms + 7
    expected = len(space.of_robot) - of_ini + len(drawing_pins(mechanism)) + rate + asking
    assert module.pin_count == expected


def test_inverse_is_our_models_on_a_thousand_poses(module, case):
    theirs = np.array([module.inverse(pose) for pose in case.poses_out()])
    worst = np.abs(theirs - case.joints_out()).max()
    tell(f"{case.robot.name}: inverse, largest difference {worst:.1e} deg or mm")
    assert worst <= case.same


def test_forward_finds_every_pose_again_from_far_and_from_near(module, case):
    wanted = case.poses_out()
    far = np.array([module.forward(joints) for joints in case.joints_out()])
    near = np.array(
        [module.forward(j, p + 1.0) for j, p in zip(case.joints_out(), wanted, strict=True)]
    )
    worst = np.abs(np.concatenate([far, near]) - np.concatenate([wanted, wanted])).max()
    tell(f"{case.robot.name}: forward, largest difference {worst:.1e} mm or deg")
    assert worst <= case.same


def test_pose_that_is_asked_for_is_that_of_the_joints_asked_for(module, case):
    here, there = case.joints_out()[0], case.poses_out()[1]
    for number, joints in enumerate((case.joints_out()[1], [0.0] * module.arms), start=1):
        module.set_pins({f"pkmkins.ask.joint{n}": joint for n, joint in enumerate(joints)})
        module.set_pins({"pkmkins.ask.number": float(number)})
        assert module.forward(here) is not None
        assert module.pin("pkmkins.ask.answered") == number
        if number == 1:
            pose = [module.pin(f"pkmkins.ask.{letter}") for letter in "xyzc"]
            assert module.pin("pkmkins.ask.found") == 1.0
            assert pose[: len(there)] == pytest.approx(there, abs=case.same)


@pytest.mark.parametrize("extended", [True], ids=["full"], indirect=True)
def test_unequal_rods_and_tilted_axes_do_move_the_plate(loaded, case):
    """The comparisons above would pass too if both left the extensions out."""
    space = case.robot.mechanism.parameters
    flat = dict(case.robot.parameters)
    level = RobotFile.of(
        case.robot.mechanism,
        {name: flat[name] for name in space.names},
        name="level",
        limits=case.robot.limits,
    )
    module = loaded(case.robot.mechanism.name)
    module.set_robot(level)
    joints = np.array([module.inverse(pose) for pose in case.poses_out()[:50]])
    assert np.abs(joints - case.joints_out()[:50]).max() > 1e-3


def test_forward_from_the_wrong_assembly_ends_on_the_right_one(module, case):
    above = case.poses_out()[:100].copy()
    above[:, 2] += 60.0
    above[:, 3:] += 100.0
    found = [module.forward(j, p) for j, p in zip(case.joints_out()[:100], above, strict=True)]
    assert np.abs(np.array(found) - case.poses_out()[:100]).max() <= case.same


def test_pose_out_of_reach_is_refused(module, case):
    assert module.inverse((3000.0, 0.0, -500.0, 0.0)) is None
    if case.robot.mechanism.name in {"par4", "h4"}:
        assert module.inverse((0.0, 0.0, -575.0, 95.0)) is None


def test_pose_whose_joints_would_carry_the_plate_elsewhere_is_refused(module, case):
    draw = np.random.default_rng(6)
    low, high = case.poses_out().min(axis=0), case.poses_out().max(axis=0)
    wide = draw.uniform(low - BEYOND, high + BEYOND, (4000, len(low)))
    wide[:, 3:] = draw.uniform(-89.0, 89.0, (len(wide), len(low) - 3))
    checked = 0
    for pose in wide:
        joints = module.inverse(pose)
        if joints is not None:
            assert module.forward(joints, pose) == pytest.approx(pose, abs=1e-5)
            checked += 1
    assert checked > 200


def test_joints_without_an_assembly_are_refused(module, case):
    module.set_pins({pin_of(f"arm{arm}.forearm_mm"): 10.0 for arm in range(module.arms)})
    assert module.forward([0.0] * module.arms) is None


@pytest.mark.parametrize("value", [0.0, -100.0, float("nan"), float("inf")])
def test_parameters_that_are_no_robots_refuse_everything(module, case, value):
    module.set_pins({pin_of("arm1.forearm_mm"): value})
    assert module.inverse(case.poses_out()[0]) is None
    assert module.forward(case.joints_out()[0]) is None


def test_unknown_type_is_refused(loaded):
    assert not loaded("hexapod").started


def test_no_call_takes_a_servo_period_not_even_one_without_a_solution(module, case, extended):
    """The least of three times of each call, for this machine does other things too."""
    draw = np.random.default_rng(8)
    wild = {}
    for which, rows in (
        ("kinematicsInverse", case.poses_out()),
        ("kinematicsForward", case.joints_out()),
    ):
        middle, half = rows.mean(axis=0), np.ptp(rows, axis=0)
        wild[which] = middle + draw.uniform(-1.5, 1.5, (2000, rows.shape[1])) * half
    longest_us = {
        which: np.min([module.times_us(which, rows) for _ in range(3)], axis=0).max()
        for which, rows in wild.items()
    }
    told = "; ".join(f"{which} {us:.1f} us at most" for which, us in longest_us.items())
    tell(f"{case.robot.name}{' full' if extended else ''}, anywhere: {told}")
    assert max(longest_us.values()) < SERVO_US
