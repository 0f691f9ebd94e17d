"""Poses that cannot be measured: set aside, tried once more at the end, skipped, and named."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from fake_cell import FakeCell
from small_plans import FOUR_PAIRS, GATE, work
from tested_journal import journal_in

from campaigns.errors import TargetOutOfReach
from campaigns.journal.records import Event, Rejected
from campaigns.measuring.results import Loss, Lost, failure_of
from campaigns.planning.plan_file import PlannedShot
from drivers.errors import BeamBroken, LimitViolation, NoReflector
from drivers.values import Measurement

LATER = work(FOUR_PAIRS).steps[3].planned
"""A shot in the middle: the first of the pair 1, with number 3."""


def blind_at(cell: FakeCell, shots: Sequence[PlannedShot]) -> None:
    """The reflector cannot be seen at these poses."""
    measure = cell.tracker.measure

    def sees_there() -> bool:
        here = cell.robot.true_joints()
        return not any(np.allclose(here, shot.joints, atol=1e-4) for shot in shots)

    def measured() -> Measurement:
        if sees_there():
            cell.tracker.beam_broken = False
            return measure()
        cell.calls.append(("tracker.measure",))
        raise NoReflector("no reflector", remedy="look for it")

    def search(*call: object) -> None:
        cell.calls.append(call)
        cell.tracker._wait(1.0)
        if not sees_there():
            raise BeamBroken("no reflector found", remedy="look for it")

    cell.tracker.measure = measured
    cell.tracker.go_to = lambda point: search("tracker.go_to", point)
    cell.tracker.find_reflector = lambda distance: search("tracker.find_reflector", distance)


def refusing(cell: FakeCell, shots: Sequence[PlannedShot]) -> None:
    move = cell.robot.move_joints

    def moved(joints, speed_fraction: float) -> None:
        if any(np.allclose(joints, shot.joints) for shot in shots):
            raise LimitViolation("joint 1 outside", remedy="compare limits")
        move(joints, speed_fraction)

    cell.robot.move_joints = moved


def skips(journal) -> list[Event]:
    return [e.record for e in journal.records_of(Event) if e.record.kind == "shot skipped"]


def test_target_that_the_controller_refuses_costs_one_pair_and_is_tried_once_more(
    tmp_path: Path,
) -> None:
    cell = FakeCell()
    refusing(cell, [LATER])
    journal = cell.run(tmp_path, work(FOUR_PAIRS))
    assert [shot.intent.shot for shot in journal.shots()] == [0, 1, 2, 5, 6, 7, 8, 9]
    aside, skipped = skips(journal)
    assert journal.latest_series("run").finished
    tries = [e.record.attempt for e in journal.records_of(Rejected) if e.record.shot == 3]
    assert aside.shots == skipped.shots == (3, 4)
    assert aside.text == (
        "shots 3–4 set aside, to be tried once more at the end: the attempt failed, the last one: "
        "shot 3: joint 1 outside"
    )
    assert skipped.text.startswith("shots 3–4 skipped:")
    assert tries == [1, 2]
    assert cell.observer.events == [aside.text, skipped.text]
    assert (cell.observer.told[-1].done, cell.observer.told[-1].total) == (8, 10)


def test_pose_whose_reflector_cannot_be_seen_is_told_from_a_broken_beam_by_going_back(
    tmp_path: Path,
) -> None:
    cell = FakeCell()
    blind_at(cell, [LATER])
    journal = cell.run(tmp_path, work(FOUR_PAIRS))
    assert [shot.intent.shot for shot in journal.shots()] == [0, 1, 2, 5, 6, 7, 8, 9]
    assert [event.shots for event in skips(journal)] == [(3, 4), (3, 4)]
    texts = [e.record.text for e in journal.records_of(Event) if e.record.kind == "suspended"]
    assert "looking for the reflector where shot 2 was" in texts


def test_beam_that_is_broken_on_the_way_is_waited_for_where_the_reflector_was(
    tmp_path: Path,
) -> None:
    """Nobody has seen the reflector at the new pose, and yet it is not the pose's fault."""
    cell = FakeCell()

    def break_beam() -> None:
        cell.tracker.finds = False
        cell.tracker.beam_broken = True
        cell.clock.after(500.0, lambda: setattr(cell.tracker, "finds", True))

    measure = cell.tracker.measure

    def measured() -> Measurement:
        if cell.tracker.beam_broken:
            raise NoReflector("no reflector", remedy="look for it")
        return measure()

    cell.tracker.measure = measured
    cell.robot.during_move = {4: break_beam}
    with journal_in(tmp_path, cell.calls) as journal:
        once = GATE.model_copy(update={"attempts": 1})
        series = cell.measure(journal, work(FOUR_PAIRS, gate=once))
        assert len(journal.shots(series)) == len(FOUR_PAIRS)
        assert not skips(journal)


def test_error_of_a_pose_without_a_way_names_what_its_cause_needs() -> None:
    refused = TargetOutOfReach("no safe way to shot 0", remedy="jog the robot")

    error = failure_of(Lost("shot 0: no safe way to shot 0", Loss.TARGET, refused))

    assert (error.problem, error.remedy) == (
        "the attempt failed, the last one: shot 0: no safe way to shot 0",
        "jog the robot",
    )
