"""Settling: what visits of the drift pose say of a robot that warms up."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from goal_plans import PLAN, noisy_cell
from small_plans import work

from campaigns.evaluation.time_series import settling
from campaigns.journal.records import Event

COVARIANCE = np.diag([0.01, 0.01, 0.02]) ** 2
AWAY = np.array([0.2, -0.1, 0.05])


def visits(parts: list[float], rng: np.random.Generator) -> tuple[list[int], np.ndarray]:
    noise = rng.standard_normal((len(parts), 3)) @ np.sqrt(COVARIANCE)
    return [10 * n for n in range(len(parts))], np.outer(parts, AWAY) + noise


def test_a_robot_at_rest_has_settled_since_its_first_visit_in_all_but_one_of_a_thousand() -> None:
    rng, late = np.random.default_rng(1), 0
    for _ in range(1000):
        since, _ = settling(*visits([0.0] * 9, rng), np.array([COVARIANCE] * 9))
        late += since[:1] != (0,)
    assert late <= 5


def test_a_robot_that_warmed_up_has_settled_since_the_visit_from_which_it_stays() -> None:
    parts = [0.0, 0.4, 0.7, 1.0, 1.0, 1.0, 1.0]
    since, says = settling(*visits(parts, np.random.default_rng(2)), np.array([COVARIANCE] * 7))
    assert since == (30, 40, 50, 60)
    assert says.startswith("no drift since shot 30: the drift pose repeats within")


def test_a_robot_that_still_moves_is_said_to() -> None:
    parts = [0.0, 0.3, 0.5, 0.7, 0.9]
    since, says = settling(*visits(parts, np.random.default_rng(3)), np.array([COVARIANCE] * 5))
    assert since == ()
    assert says.startswith("the robot still warms up or moves: its drift pose by 0.1")


@pytest.mark.parametrize("moves", [False, True], ids=["at rest", "warm"])
def test_a_run_says_when_the_robot_settles_and_only_notes_that_it_stood_at_rest(
    tmp_path: Path, moves: bool
) -> None:
    last = len(PLAN)
    shots = (*PLAN, *(replace(PLAN[0], shot=last + n) for n in range(3)))
    cell = noisy_cell()

    def warm() -> None:
        cell.tracker.shifted_mm[:] += (0.5, 0.0, 0.0)

    cell.tracker.during_measure = {last: warm} if moves else {}
    journal = cell.run(tmp_path, work(shots))
    events = [each.record for each in journal.records_of(Event) if each.record.kind == "settling"]
    heard = [text for text in cell.observer.events if text in {event.text for event in events}]
    if moves:
        assert ["still warms" in text for text in heard] == [True, False]
        assert events[-1].shots[0] == last - 1
    else:
        assert heard == []
        assert [event.shots[0] for event in events] == [0]
