"""From which side each joint came, as the journal's shots tell it."""

from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from fake_cell import FakeCell
from journal_story import imported, intent, outcome
from small_plans import FOUR_PAIRS, work
from tested_journal import journal_in

from campaigns.journal.views import AcceptedShot
from campaigns.kinematics.catalog import PAR4
from campaigns.shots.shots import approach_directions, shots_of_journal

HERE = np.radians([10.0, 20.0, 30.0, 40.0])
ARCMIN = np.radians(1.0 / 60.0)


def directions_of(shots):
    order = sorted(range(len(shots)), key=lambda row: shots[row].number)
    return approach_directions([shot.outcome for shot in shots], order, PAR4.joints)


def shot(number, joints, came_from, record=None):
    """Measured in the order of numbers unless a place in the journal is given; no clock is used."""
    measured = replace(
        outcome(number),
        joints=tuple(joints),
        came_from=None if came_from is None else tuple(came_from),
    )
    when = f"2026-03-02T08:00:{59 - number:02d}.000+00:00"
    return AcceptedShot(intent(number), measured, when, number if record is None else record)


def test_a_joint_came_the_way_it_moved_on_the_last_leg_if_it_moved():
    moved = np.radians([5.0, -5.0, 0.2, -0.2])
    assert directions_of([shot(1, HERE + moved, HERE)]).tolist() == [[1.0, -1.0, 1.0, -1.0]]
    moved = np.array([3.0, -3.0, 0.0, 6.0]) * ARCMIN
    assert directions_of([shot(1, HERE + moved, HERE)]).tolist() == [[0.0, 0.0, 0.0, 1.0]]
    assert directions_of([]).shape == (0, 4)


def test_a_joint_that_was_not_turned_round_keeps_the_direction_of_the_shot_before():
    up, down = HERE + np.radians(10.0), HERE - np.radians(10.0)
    before = shot(1, HERE, np.array([down[0], up[1], down[2], up[3]]))
    a_little = np.array([3.0, -3.0, 0.0, 0.1]) * ARCMIN
    directions = directions_of([before, shot(2, HERE + a_little, HERE)])
    assert directions[1].tolist() == [1.0, -1.0, 1.0, -1.0]


def test_a_joint_that_was_turned_round_by_a_little_is_unknown():
    """It may have taken up its lost motion, or some of it, or nothing."""
    before = shot(1, HERE, HERE - np.radians([10.0, -10.0, 10.0, -10.0]))
    back = np.array([-3.0, 3.0, -60.0, 60.0]) * ARCMIN
    assert directions_of([before, shot(2, HERE + back, HERE)])[1].tolist() == [0.0, 0.0, -1.0, 1.0]


def test_a_direction_is_kept_at_one_place_unless_the_robot_was_elsewhere():
    first = shot(1, HERE, HERE - np.radians(10.0))
    others = [shot(number, HERE, HERE) for number in range(2, 6)]
    assert (directions_of([first, *others]) == 1.0).all()
    before = shot(1, HERE, HERE - np.radians(10.0))
    elsewhere = HERE + np.radians([0.0, 0.0, 0.0, 20.0])
    directions = directions_of([before, shot(2, HERE, elsewhere)])
    assert directions[1].tolist() == [0.0, 0.0, 0.0, -1.0]


def test_the_shot_before_is_the_one_measured_before_and_not_the_lower_number():
    """The pair of shots 1 and 2 was measured again, after shot 3."""
    there = HERE + np.radians([0.0, 10.0, -10.0, 10.0])
    third = shot(3, HERE, HERE + np.radians(10.0), record=10)
    first = shot(1, there, HERE, record=20)
    second = shot(2, HERE, there, record=30)
    directions = directions_of([first, second, third])
    assert directions[2].tolist() == [-1.0, -1.0, -1.0, -1.0]
    assert directions[0].tolist() == [-1.0, 1.0, -1.0, 1.0]
    assert directions[1].tolist() == [-1.0, -1.0, 1.0, -1.0]


def test_shots_of_an_older_journal_or_of_other_software_have_no_direction():
    known = shot(1, HERE, HERE - np.radians(10.0))
    older = shot(2, HERE, None)
    after = shot(3, HERE, HERE)
    assert directions_of([known, older, after]).tolist() == [[1.0] * 4, [0.0] * 4, [0.0] * 4]
    received = AcceptedShot(intent(1), imported(1), "2026-03-02T08:00:00Z")
    data = shots_of_journal([received], PAR4)
    assert data.approach.tolist() == [[0.0] * 4]
    assert not data.approach.any()


def test_a_measured_series_tells_from_where_its_joints_came(tmp_path: Path) -> None:
    cell = FakeCell()
    with journal_in(tmp_path, cell.calls) as journal:
        shots = journal.shots(cell.measure(journal, work(FOUR_PAIRS)))
    data = shots_of_journal(shots, PAR4)
    stops = np.array([planned.joints for planned in FOUR_PAIRS])
    assert data.approach.any()
    assert (data.approach[1:] == np.sign(np.diff(stops, axis=0))).all()
    for before, after in pairwise(shots):
        assert after.outcome.came_from == pytest.approx(before.outcome.joints)
