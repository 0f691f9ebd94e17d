"""Records as stored text: nothing is lost, and nothing that cannot be read is written."""

import json
import math
from pathlib import Path
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
outcomes = st.builds(
    records.Outcome,
    shot=numbers,
    attempt=numbers,
    joints=st.lists(finite, max_size=6).map(tuple),
    point_in_tracker_mm=vectors,
    covariance_mm2=st.none() | st.tuples(vectors, vectors, vectors),
    weather=st.none() | st.builds(Weather, finite, finite, finite),
    raw_robot=words,
    raw_tracker=words,
    durations=st.none() | st.builds(records.Durations, finite, finite, finite),
    predicted_in_tracker_mm=st.none() | vectors,
    residual_mm=st.none() | finite,
    came_from=st.none() | st.lists(finite, max_size=6).map(tuple),
)
intents = st.builds(
    records.Intent,
    shot=numbers,
    attempt=numbers,
    purpose=words,
    target=st.builds(Pose, finite, finite, finite, finite),
    target_joints=st.lists(finite, max_size=6).map(tuple),
    command=st.sampled_from(["joints", "pose"]),
)
plain = st.recursive(
    st.none() | st.booleans() | st.integers() | finite | words,
    lambda inner: st.lists(inner) | st.dictionaries(words, inner),
    max_leaves=8,
)
findings = st.builds(records.Finding, st.just("validation"), st.dictionaries(words, plain))


@pytest.mark.slow
@given(st.one_of(outcomes, intents, findings))
def test_a_record_comes_back_equal_to_the_last_bit(record: records.Record) -> None:
    kind = records.KIND_OF_TYPE[type(record)]
    assert records.from_text(kind, records.as_stored(record)) == record


@given(outcomes)
def test_a_rejected_shot_keeps_its_data(measured: records.Outcome) -> None:
    rejected = records.Rejected(measured.shot, measured.attempt, "gate", measured)
    assert records.from_text("rejected", records.as_stored(rejected)) == rejected


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_a_number_that_is_not_finite_is_not_written(bad: float) -> None:
    with pytest.raises(ValueError, match="JSON compliant"):
        records.as_stored(outcome(1, x_mm=bad))
    with pytest.raises(ValueError, match="JSON compliant"):
        records.as_stored(records.Finding("validation", {"rotation_mm": [bad]}))


@pytest.mark.parametrize(
    "unreadable",
    [
        records.Outcome(1, 1, (0.0,), (1.0, 2.0), None, None, "", "", None),  # type: ignore[arg-type]  # on purpose
        records.Event("gossip", ""),  # type: ignore[arg-type]  # on purpose
        records.Event("operator note", "half a sign \ud800"),
    ],
)
def test_what_could_not_be_read_is_not_written(unreadable: records.Record) -> None:
    with pytest.raises(ValueError, match=r"outcome: point_in_tracker_mm|event: "):
        records.as_stored(unreadable)


@pytest.mark.parametrize("odd", [object(), {1, 2}, b"raw", Path("set.yaml")])
def test_plain_data_only_is_written(odd: Any) -> None:
    with pytest.raises(TypeError):
        records.as_stored(records.Finding("load", {"path": odd}))


def test_records_of_older_and_newer_programs_are_read() -> None:
    told = json.loads(records.as_stored(outcome(1)))
    del told["came_from_rad"]
    assert records.from_text("outcome", json.dumps(told)) == outcome(1)
    newer = json.dumps(json.loads(records.as_stored(outcome(1))) | {"humour": "good"})
    assert records.from_text("outcome", newer) == outcome(1)


def test_every_kind_has_a_name_and_unknown_kinds_and_others_data_are_refused() -> None:
    assert len(records.KIND_OF_TYPE) == len(records.TYPE_OF_KIND)
    assert set(records.KIND_OF_TYPE) == set(records.Record.__args__)
    with pytest.raises(ValueError, match="gossip"):
        records.from_text("gossip", "{}")
    with pytest.raises(ValueError, match="another shot's data"):
        records.Rejected(2, 1, "gate", outcome(1))
