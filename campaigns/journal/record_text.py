"""Records as the text that the journal stores, and back."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

from pydantic import TypeAdapter, ValidationError

from campaigns.journal.records import (
    Event,
    Finding,
    Intent,
    Outcome,
    PairVoided,
    Record,
    Rejected,
    SeriesFinished,
    SeriesStarted,
    SessionStarted,
    SessionStopped,
)

TYPE_OF_KIND: Mapping[str, type[Record]] = {
    "series-started": SeriesStarted,
    "series-finished": SeriesFinished,
    "session-started": SessionStarted,
    "session-stopped": SessionStopped,
    "intent": Intent,
    "outcome": Outcome,
    "rejected": Rejected,
    "pair-voided": PairVoided,
    "event": Event,
    "finding": Finding,
}
KIND_OF_TYPE: Mapping[type[object], str] = {type_: kind for kind, type_ in TYPE_OF_KIND.items()}

# Any: an adapter's type parameter cannot be carried through a table of ten different records.
_READERS: Mapping[str, TypeAdapter[Any]] = {
    kind: TypeAdapter(type_) for kind, type_ in TYPE_OF_KIND.items()
}


def to_text(record: Record) -> str:
    """Write the record as JSON that `from_text` is known to read.

    Raises `ValueError` or `TypeError` when a value is not finite, not plain data or not Unicode.
    """
    text = json.dumps(asdict(record), allow_nan=False, ensure_ascii=False)
    from_text(KIND_OF_TYPE[type(record)], text)
    return text


def from_text(kind: str, text: str) -> Record:
    """Read the record that was stored; raises `ValueError` when it is none of that kind."""
    if kind not in _READERS:
        raise ValueError(f"unknown kind of record {kind!r}")
    try:
        record: Record = _READERS[kind].validate_json(text, strict=True)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "text"
        raise ValueError(f"{kind}: {where}: {first['msg']}") from error
    return record
