"""Settling: what visits of the drift pose say of a robot that warms up."""

from dataclasses import replace
from pathlib import Path

import numpy as np
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


def test_a_run_announces_that_a_robot_warms_up_and_since_when_it_has_settled(
    tmp_path: Path,
) -> None:
    last = len(PLAN)
    shots = (*PLAN, *(replace(PLAN[0], shot=last + n) for n in range(3)))
    cell = noisy_cell()

    def warm() -> None:
        cell.tracker.shifted_mm[:] += (0.5, 0.0, 0.0)

    cell.tracker.during_measure = {last: warm}
    journal = cell.run(tmp_path, work(shots))
    events = [e.record for e in journal.records_of(Event) if e.record.kind == "settling"]
    texts = {event.text for event in events}
    announced = [text for text in cell.observer.events if text in texts]
    assert ["still warms" in text for text in announced] == [True, False]
    assert events[-1].shots[0] == last - 1
