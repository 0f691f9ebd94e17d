"""Errors between encoders and joints are as large as told, and torques are the weight's."""

from dataclasses import replace

import numpy as np
import pytest
from family_cases import ALL_MEMBERS

from sim.geometry import PLATE_KINDS, geometry_of
from sim.robot.rods import Build, Plate, RodMechanism
from sim.robot.transmission import Load, Transmission

ANGLES = np.linspace(-np.pi, np.pi, 721)[:, None] * np.ones(3)


def test_an_eccentric_scale_is_off_by_its_size_once_a_turn():
    gears = replace(
        Transmission.perfect(3), eccentricity=np.array([0.0, 1e-3, 0.0]), phase_rad=np.ones(3)
    )
    off = gears.joints(ANGLES) - ANGLES
    assert np.abs(off).max(axis=0) == pytest.approx([0.0, 1e-3, 0.0], rel=1e-3, abs=1e-12)
    assert np.sum(np.diff(np.sign(off[:, 1])) != 0) == 2
    # from the axis a mark of the scale is seen elsewhere than from the scale's centre
    truth, seen = np.exp(1j * gears.joints(ANGLES)[:, 1]), np.exp(1j * ANGLES[:, 1])
    aside = 1e-3 * np.exp(1j)
    assert np.abs(np.imag((seen - aside) / truth)).max() < 1e-12


def test_a_ratio_and_a_screw_are_off_along_the_way():
    gears = replace(
        Transmission.perfect(3),
        ratio=np.array([1e-3, 0, 0]),
        ripple=np.array([0, 0, 0.02]),
        motor_rad=2.0 * np.pi / 10.0,
    )
    places = np.linspace(0.0, 100.0, 1001)[:, None] * np.ones(3)
    off = gears.joints(places) - places
    assert off[-1, 0] == pytest.approx(0.1)
    assert np.abs(off[:, 2]).max() == pytest.approx(0.02, rel=1e-3)
    assert np.abs(off[::100, 2]).max() < 1e-9


@pytest.mark.parametrize("member", ALL_MEMBERS, ids=lambda each: each.name)
def test_torques_of_the_weight_are_the_plates_rise(member):
    """By virtual work, against plates that have settled a little beside."""
    robot, kind = member.nominal, PLATE_KINDS[member.name]
    geometry = geometry_of({name: robot.parameters[name] for name in member.space.names}, kind)
    arms = kind.arms
    aside = 50.0 * geometry.outward
    rods = RodMechanism(geometry, Build(aside, 80.0, np.zeros((arms, 2)), np.zeros(arms)))
    (pose,) = member.reachable_poses(robot, 1, seed=3)
    joints = robot.inverse(pose[None]).values_or_raise()[0]
    level = Plate.level(kind, pose[:3], float(pose[3:].sum()))
    plate = rods.settle(joints, level)[0]
    step = 1e-4 * float(kind.scales[0])
    heights = [
        rods.settle(joints + step * one, plate)[0].position_mm[2]
        - rods.settle(joints - step * one, plate)[0].position_mm[2]
        for one in np.eye(arms)
    ]
    elbow, rise = rods.heights_by_joints(joints, plate)
    assert rise == pytest.approx(np.array(heights) / (2.0 * step), rel=1e-4, abs=1e-6)
    angles = joints + geometry.joint_offsets
    own = geometry.rails[:, 2] if kind.on_rails else -geometry.arms_mm * np.cos(angles)
    assert elbow == pytest.approx(own, abs=1e-3)
    given = Load(at_elbow_n=10.0, at_plate_n=20.0, stiffness=1e6).yielding(rods, joints, plate)
    assert given == pytest.approx(-1e-5 * own - 2e-5 * rise, abs=1e-7)
