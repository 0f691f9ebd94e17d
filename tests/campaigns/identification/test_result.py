"""The five parts of a result, and the one flat document that is stored of them."""

import json
from collections import Counter
from dataclasses import fields
from pathlib import Path

import pytest

from campaigns.errors import FindingUnreadable
from campaigns.identification.result import RecordedIdentification, read_identification

STORED = Path(__file__).parents[2] / "data" / "identification-2.json"
"""Body of a journal's finding, from when a result was one flat value: wrong shots, a change, two
sessions, ripples and a layer."""

LATER: dict[str, object] = {"determined": [], "motions": [], "observations": 0}
"""Keys that came later, with what a document without them stands for."""


@pytest.fixture(scope="module")
def stored():
    return json.loads(STORED.read_text(encoding="utf-8"))


def test_no_two_parts_have_a_field_of_one_name(stored):
    parts = [part.type for part in fields(RecordedIdentification)]
    counts = Counter(field.name for part in parts for field in fields(part))
    assert [name for name, count in counts.items() if count > 1] == []
    assert {*counts, "schema", "correlations"} == {*stored, *LATER}


def test_a_document_of_before_the_parts_is_read_and_written_equal(stored):
    result = read_identification(stored)
    no_frame = {"frame": None, "frame_covariance": []}  # a later version stores them
    posterior = {**stored["posterior"], **no_frame}
    assert result.document() == {**stored, **LATER, "posterior": posterior}
    assert read_identification(result.document()) == result
    parts = result.value, result.uncertainty, result.judgement, result.residuals, result.provenance
    empty = {f.name for part in parts for f in fields(part) if not getattr(part, f.name)}
    assert empty == {"reference_degC", "settings", "pedigree", *LATER}


def test_a_document_without_a_key_is_refused_by_that_key(stored):
    for key in ("parameters", "verdict", "robot_digest"):
        body = {name: value for name, value in stored.items() if name != key}
        with pytest.raises(FindingUnreadable, match=f"the journal's identification, {key}: "):
            read_identification(body)
