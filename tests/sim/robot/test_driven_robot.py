"""Between encoders and mechanism: backlash, repeatability, warm arms, edges of the workspace."""

import math
from dataclasses import replace

import numpy as np
import pytest

from sim.geometry import geometry_of
from sim.random_streams import Attempts, Purpose, WorkedTime, target_key
from sim.robot.assembly import assemble, follow
from sim.robot.driven_robot import Behaviour, DrivenRobot, SeenReflector, Standing
from sim.robot.rods import Build, RodMechanism
from sim.robot.section import Thermal, Warmth, nominal_robot
from sim.robot.transmission import WEIGHTLESS, Load, Transmission

GEOMETRY = geometry_of(nominal_robot("par4-prototype")[1])
COLD = Thermal()
PERFECT = Transmission.perfect(4)
ARCMIN = math.radians(1.0 / 60.0)
TEN_DEG = np.radians([10.0, 10.0, 10.0, 10.0])


def behaviour(
    *, backlash=0.0, joint_noise=0.0, position_mm=0.0, thermal=COLD, gears=PERFECT, load=WEIGHTLESS
):
    return Behaviour(np.full(4, backlash), joint_noise, position_mm, thermal, gears, load)


def driven(behaviour, *, seed=1, worked=None):
    build = Build(np.zeros((4, 3)), 80.0, np.zeros((4, 2)), np.zeros(4))
    rods = RodMechanism(GEOMETRY, build)
    start = assemble(rods, GEOMETRY, np.array([0.0, 0.0, -575.0]), 0.0)
    standing = Standing(start.joints, np.zeros(4), start, np.zeros(3))
    mount = SeenReflector(np.array([0.0, 0.0, -50.0]), np.array([1.0, 0.0, 0.0]))
    worked = worked or WorkedTime(0.0)
    return DrivenRobot(
        rods,
        behaviour,
        mount,
        standing,
        worked=worked,
        arrivals=Attempts(seed, Purpose.ARRIVAL, {}),
    )


def move(robot, encoders):
    assert robot.passable_part(encoders) == 1.0
    robot.arrive(encoders, target_key(encoders))
    return robot.reflector(encoders).point_mm


def test_backlash_leaves_the_arms_behind_on_both_sides():
    robot = driven(behaviour(backlash=ARCMIN))
    home = robot.standing.encoders
    move(robot, home - TEN_DEG)
    from_below = move(robot, home)
    assert robot.standing.play == pytest.approx(np.full(4, -ARCMIN / 2))
    move(robot, home + TEN_DEG)
    from_above = move(robot, home)
    assert robot.standing.play == pytest.approx(np.full(4, ARCMIN / 2))
    assert 0.05 < np.linalg.norm(from_above - from_below) < 0.5


def test_each_arrival_differs_and_each_seed_repeats_itself():
    def visits(seed):
        robot = driven(behaviour(position_mm=0.2, joint_noise=1e-6), seed=seed)
        home = robot.standing.encoders
        return [move(robot, target) for target in (home, home + TEN_DEG, home)]

    first, again, other = visits(1), visits(1), visits(2)
    assert np.array_equal(first, again)
    assert not np.array_equal(first, other)
    assert 1e-3 < np.abs(first[0] - first[2]).max() <= 0.41


def test_a_draw_depends_on_the_target_and_not_on_the_way():
    ways = ([TEN_DEG], [TEN_DEG, -TEN_DEG, TEN_DEG * 0.3])
    ends = []
    for way in ways:
        robot = driven(behaviour(position_mm=0.2))
        home = robot.standing.encoders
        for step in way:
            move(robot, home + step)
        ends.append(move(robot, home))
    assert ends[0] == pytest.approx(ends[1], abs=1e-10)


def test_looking_at_a_moving_robot_does_not_change_where_it_ends():
    watched, unwatched = driven(behaviour(backlash=ARCMIN)), driven(behaviour(backlash=ARCMIN))
    home = watched.standing.encoders
    watched.passable_part(home + TEN_DEG)
    for part in (0.2, 0.5, 0.9):
        watched.reflector(home + part * TEN_DEG)
    assert np.array_equal(move(watched, home + TEN_DEG), move(unwatched, home + TEN_DEG))


def test_arms_grow_with_worked_time_toward_their_end():
    worked = WorkedTime(0.0)
    robot = driven(behaviour(thermal=Thermal(arm_ppm_per_degC=50.0, rise_degC=1.0)), worked=worked)
    home = robot.standing.encoders
    heights = []
    for _ in range(4):
        heights.append(robot.reflector(home).point_mm[2])
        worked.seconds += 1800.0
    steps = np.diff(heights)
    assert steps[0] > 0.005
    assert steps[1] / steps[0] == pytest.approx(math.exp(-1.0), rel=1e-3)


def test_forearms_and_frame_grow_each_in_their_own_time():
    growth = Thermal(
        forearms=Warmth(ppm_per_degC=23.0, rise_degC=2.0, time_constant_s=600.0),
        frame=Warmth(ppm_per_degC=12.0, rise_degC=3.0, time_constant_s=7200.0),
    ).growth(600.0)
    assert growth.arms == 0.0
    assert growth.forearms == pytest.approx(46e-6 * (1.0 - math.exp(-1.0)))
    assert growth.frame == pytest.approx(36e-6 * (1.0 - math.exp(-1.0 / 12.0)))


def test_an_encoder_and_a_motor_that_are_off_put_the_arms_elsewhere():
    gears = replace(PERFECT, ripple=np.full(4, 1e-4), motor_rad=30.0)
    gears = replace(gears, eccentricity=np.full(4, 3e-4), phase_rad=np.arange(4.0))
    robot = driven(behaviour(gears=gears))
    target = robot.standing.encoders + TEN_DEG
    move(robot, target)
    off = robot.standing.assembly.joints - target
    eccentric = 3e-4 * np.sin(target - np.arange(4.0))
    assert off == pytest.approx(eccentric + 1e-4 * np.sin(30.0 * target), abs=1e-6)
    assert np.abs(off).max() > 1e-4


def test_gears_that_yield_lower_the_plate_the_more_the_heavier_it_is():
    def height_mm(kg):
        load = Load(at_elbow_n=5.0, at_plate_n=9.81 * kg, stiffness=1e8)
        robot = driven(behaviour(load=load))
        target = robot.standing.encoders + TEN_DEG
        return move(robot, target)[2], robot.standing.assembly.joints - target

    (empty, _), (light, _), (heavy, given) = height_mm(0.0), height_mm(1.0), height_mm(3.0)
    assert heavy - empty == pytest.approx(3.0 * (light - empty), rel=1e-3)
    assert -0.05 < heavy - light < -0.005
    assert (given > 0.0).all(), "arms sink with growing angles"


def test_the_way_to_a_singularity_is_open_only_short_of_it():
    robot = driven(behaviour())
    home, target = robot.standing.encoders, np.radians([90.0, -45.0, 90.0, -45.0])
    part = robot.passable_part(target)
    assert 0.0 < part < 1.0
    edge = home + part * (target - home)
    robot.arrive(edge, target_key(edge))
    assert abs(follow(robot._mechanism, robot.standing.assembly, home).plate.theta_rad) < 1e-9
