"""Records as stored text: nothing is lost, and nothing that cannot be read is written."""

import json
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from journal_story import outcome

from campaigns.journal import records
from drivers.values import Pose, Weather

finite = st.floats(allow_nan=False, allow_infinity=False)
numbers = st.integers(1, 10_000)
words = st.text(st.characters(exclude_categories=["Cs"]))
vectors = st.tuples(finite, finite, finite)
joints = st.lists(finite, max_size=6).map(tuple)
outcomes = st.builds(
    records.Outcome,
    shot=numbers,
    attempt=numbers,
    joints=joints,
    point_in_tracker_mm=vectors,
    covariance_mm2=st.none() | st.tuples(vectors, vectors, vectors),
    weather=st.none() | st.builds(Weather, finite, finite, finite),
    raw_robot=words,
    raw_tracker=words,
    durations=st.none() | st.builds(records.Durations, finite, finite, finite),
    predicted_in_tracker_mm=st.none() | vectors,
    residual_mm=st.none() | finite,
    came_from=st.none() | joints,
)
rejections = outcomes.map(lambda shot: records.Rejected(shot.shot, shot.attempt, "gate", shot))
intents = st.builds(
    records.Intent,
    shot=numbers,
    attempt=numbers,
    purpose=words,
    target=st.builds(Pose, finite, finite, finite, finite),
    target_joints=joints,
    command=st.sampled_from(["joints", "pose"]),
)
plain = st.recursive(
    st.none() | st.booleans() | st.integers() | finite | words,
    lambda inner: st.lists(inner) | st.dictionaries(words, inner),
    max_leaves=8,
)
findings = st.builds(records.Finding, st.just("validation"), st.dictionaries(words, plain))


@pytest.mark.slow
@given(st.one_of(outcomes, rejections, intents, findings))
def test_a_record_comes_back_equal_to_the_last_bit(record: records.Record) -> None:
    kind = records.KIND_OF_TYPE[type(record)]
    assert records.from_text(kind, records.as_stored(record)) == record


@pytest.mark.parametrize(
    ("unreadable", "problem"),
    [
        (outcome(1, x_mm=math.nan), "JSON compliant"),
        (records.Finding("validation", {"rotation_mm": [math.inf]}), "JSON compliant"),
        (records.Finding("load", {"path": b"raw"}), "not JSON serializable"),  # type: ignore[dict-item]  # on purpose
        (
            records.Outcome(1, 1, (0.0,), (1.0, 2.0), None, None, "", "", None),  # type: ignore[arg-type]  # on purpose
            "outcome: point_in_tracker_mm",
        ),
        (records.Event("gossip", ""), "event: "),  # type: ignore[arg-type]  # on purpose
        (records.Event("operator note", "half a sign \ud800"), "event: "),
    ],
)
def test_what_could_not_be_read_is_not_written(unreadable: Any, problem: str) -> None:
    with pytest.raises((ValueError, TypeError), match=problem):
        records.as_stored(unreadable)


def test_records_of_older_and_newer_programs_are_read_and_unknown_kinds_refused() -> None:
    older = json.loads(records.as_stored(outcome(1)))
    del older["came_from_rad"]
    assert records.from_text("outcome", json.dumps(older)) == outcome(1)
    newer = json.dumps(older | {"humour": "good"})
    assert records.from_text("outcome", newer) == outcome(1)
    with pytest.raises(ValueError, match="gossip"):
        records.from_text("gossip", "{}")
