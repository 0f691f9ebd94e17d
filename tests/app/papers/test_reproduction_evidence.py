"""Why ours differs from the paper, in numbers."""

import math

import numpy as np
import pytest
from made_up import result, results

from app.papers.corbel2006.evidence import evidence as evidence_of
from app.papers.corbel2006.evidence import floors
from app.papers.corbel2006.printed import LINES_MM, allowed, printed
from app.papers.corbel2006.trials import PROTOTYPE, REPEATABILITY_MM, SIMULATION


@pytest.fixture
def reached(computed):
    return computed.reaches


@pytest.fixture
def evidence(monkeypatch, reached):
    """The evidence of seeds, without what takes time and needs none."""
    monkeypatch.setattr("app.papers.corbel2006.evidence.reaches", lambda: reached)
    monkeypatch.setattr("app.papers.corbel2006.evidence.floors", lambda rng: floors(rng, 3))
    return evidence_of


def test_robot_as_printed_reaches_nine_points_and_no_line(reached):
    as_printed = reached[0]
    assert as_printed.name == "par4-table1 (printed), ±45°"
    assert as_printed.points == 9
    assert all(has < asked for has, asked in zip(as_printed.lines_mm, LINES_MM, strict=True))


def test_only_our_reading_with_our_limits_does_all_three_lines(reached):
    does = {
        reach.name: all(has >= asked for has, asked in zip(reach.lines_mm, LINES_MM, strict=True))
        for reach in reached
    }
    assert [name for name, all_three in does.items() if all_three] == [
        "par4-prototype, −45° to 90°"
    ]
    assert reached[-1].points > 10_000


def test_noise_alone_leaves_more_than_the_paper_measured():
    fitted, *others = floors(np.random.default_rng(7), 300)
    rotation = next(found for found in others if found.name.startswith("rot"))
    assert rotation.draws_mm.max() < 2.0 * math.sqrt(3.0) * REPEATABILITY_MM, "the cube's diagonal"
    for found in (fitted, rotation):
        assert found.left.low > allowed(found.paper[0])[1]


def test_same_draws_give_the_same_floors():
    one, two = (floors(np.random.default_rng(7), 20) for _ in range(2))
    for left, right in zip(one, two, strict=True):
        assert (left.draws_mm == right.draws_mm).all()


def test_paper_pairs_are_as_long_as_their_errors_say(evidence):
    one = result(PROTOTYPE, 1)
    lengths = np.linspace(200.0, 600.0, 20)
    stage = one.before.model_copy(
        update={
            "lengths_mm": tuple(lengths.tolist()),
            "errors_mm": tuple((-0.05 * lengths).tolist()),
        }
    )
    pairs = evidence([one.model_copy(update={"before": stage})]).pairs
    assert pairs.share == pytest.approx(0.05)
    mean, largest = (printed(PROTOTYPE, f"{name}, before") for name in ("mean", "max"))
    assert pairs.length_for_mm(mean) == pytest.approx(146.0)
    assert pairs.length_for_mm(largest) == pytest.approx(304.0)


def test_without_the_prototype_there_is_the_rest(evidence, reached):
    found = evidence([r for r in results(1) if r.experiment == SIMULATION.name])
    assert found.pairs is None
    assert found.reaches == reached
    assert len(found.floors) == 6
