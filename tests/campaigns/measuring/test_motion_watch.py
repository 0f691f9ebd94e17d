"""Readings on the way: those of any robot pass, those that no robot can give end the run."""

import numpy as np
import pytest
from fake_cell import NOMINAL

from campaigns.measuring.motion_watch import MotionWatch
from drivers.errors import ImplausibleAnswer
from drivers.values import RobotState

AXES = NOMINAL.mechanism.joints
START, END = np.zeros(4), np.radians([30.0, -10.0, 0.0, 5.0])


def watched(readings, *, end=END, speed=0.5):
    """Give a watch of a leg its readings: time after the command, part of the way, `moving`."""
    watch = MotionWatch((tuple(START), tuple(end)), AXES, speed, 100.0)
    for after_s, part, moving in readings:
        joints = tuple((START + part * (end - START)).tolist())
        watch.see(RobotState(joints, moving, "", emergency_stop=False), 100.0 + after_s)
    return watch


@pytest.mark.parametrize(
    "readings",
    [
        [(0.0, 0.0, True), (0.05, 0.2, True), (0.1, 0.9, True), (0.3, 1.0, False)],
        [(0.0, 0.0, False), (0.05, 0.0, True), (0.1, 0.5, True), (0.3, 1.0, False)],
        [(0.07, 1.0, False)],  # the fastest robot, or a slow wire
        [(0.1, 0.5, True), (0.2, 0.5, False), (0.3, 0.5, False)],  # stopped on the way
        [(0.1, 0.5, False), (0.2, 0.6, True), (0.3, 0.9, False)],  # and gone on
        [(0.3, 0.99, False), (0.4, 1.0, False)],  # rest a little before the last tenths of a degree
    ],
)
def test_readings_of_a_robot_pass(readings):
    watched(readings)


@pytest.mark.parametrize("moving", [True, False])
def test_a_target_read_at_once_is_no_encoders(moving):
    with pytest.raises(ImplausibleAnswer, match="sooner than any robot is there"):
        watched([(0.05, 1.0, moving)])
    watched([(0.05, 1.0, moving)], speed=1.0)
    watched([(0.0, 1.0, moving)], end=np.radians([1.0, 0.0, 0.0, 0.0]))


def test_rest_at_two_places_is_motion_that_is_not_reported():
    with pytest.raises(ImplausibleAnswer, match="while its joints change"):
        watched([(0.1, 0.3, False), (0.15, 0.31, False), (0.2, 0.4, False)])


def test_it_notes_whether_the_way_and_the_motion_were_seen():
    seen = watched([(0.1, 0.5, True), (0.3, 1.0, False)])
    blind = watched([(0.0, 0.0, False), (0.3, 1.0, False)])
    assert (seen.passed, seen.moved) == (True, True)
    assert (blind.passed, blind.moved) == (False, False)
