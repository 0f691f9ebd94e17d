"""Chain of digests over a journal's records: a changed, renumbered or missing record shows.

The digest of a record is the SHA-256 of the record and of the digest before it, so that the last
one stands for all records. Version 1 stored none: the first digest that follows covers those, too.
"""

import hashlib
import json
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from campaigns.errors import JournalFailed

FROM_BACKUP = "move campaign.db and campaign.db-wal away, and bring campaign.db back from a backup"


class StoredRecord(NamedTuple):
    """Record as a row of the table; `digest` is None in a record of version 1."""

    number: int
    at_utc: str
    kind: str
    series: int | None
    shot: int | None
    attempt: int | None
    body: str
    digest: str | None


@dataclass(frozen=True, slots=True)
class Problem:
    """Damage of a journal, and the first record concerned if it is known."""

    problem: str
    record: int | None = None


class JournalDamaged(JournalFailed):
    """A journal that is not what was written; `verified` are the records before the damage."""

    def __init__(self, problem: str, verified: Sequence[StoredRecord] = ()) -> None:
        kept = f"`pkmcal run` keeps the {len(verified)} records that verify in a copy; or "
        super().__init__(problem, remedy=f"{kept if verified else ''}{FROM_BACKUP}")
        self.verified = verified


@dataclass(frozen=True, slots=True)
class Verification:
    """Records that verify, from the first on, each with its digest; and what is damaged."""

    records: list[StoredRecord]
    problems: tuple[Problem, ...] = ()


def digest_after(before: str, record: StoredRecord) -> str:
    """Return the SHA-256 (hex) of a record and of the digest of the one before it.

    Raises `TypeError` for what is neither text nor number, `ValueError` for what is not Unicode.
    """
    text = json.dumps([before, *record[:-1]], ensure_ascii=False)
    return hashlib.sha256(text.encode()).hexdigest()


def verify_chain(
    stored: Iterable[StoredRecord], stated_number: int, stated_digest: str
) -> Verification:
    """Verify records in their order.

    Number and digest of the last record that has one are those that the file states beside them;
    0 and "" for a file without digests.
    """
    records: list[StoredRecord] = []
    sealed = 0  # number of the last record with a digest: it covers all before it
    for record in stored:
        linked = _link(record, records, sealed)
        if isinstance(linked, Problem):
            return Verification(records[: (linked.record or 1) - 1], (linked,))
        records.append(linked)
        sealed = record.number if record.digest is not None else sealed
    end, digest = len(records), records[sealed - 1].digest if sealed else ""
    if sealed < stated_number:
        text = f"the records from {end + 1} to {stated_number} are missing"
        return Verification(records, (Problem(text, end + 1),))
    if (sealed, digest) != (stated_number, stated_digest):
        text = f"record {end} is not the last one that was written"
        return Verification(records, (Problem(text, end),))
    return Verification(records)


def _link(
    record: StoredRecord, before: Sequence[StoredRecord], sealed: int
) -> StoredRecord | Problem:
    """Return the record with its digest, or what is wrong from which record on."""
    number, due = record.number, len(before) + 1
    if number != due:
        return Problem(f"record {due} is missing or was renumbered: {number} comes next", due)
    try:
        digest = digest_after(last_digest(before), record)
    except UnicodeEncodeError:
        return Problem(f"record {number} holds text that is no UTF-8", number)
    except TypeError as error:
        return Problem(f"record {number} holds what none may hold: {error}", number)
    if record.digest is None and sealed:
        return Problem(f"record {number} has no digest, though those before it have one", number)
    if record.digest not in (None, digest):
        first = sealed + 1
        which = f"record {number}" if first == number else f"one of the records {first} to {number}"
        return Problem(f"{which} was changed after it was written", first)
    return record if record.digest else record._replace(digest=digest)


def last_digest(records: Sequence[StoredRecord]) -> str:
    """Return the digest of the last of verified records, which stands for all; "" of none."""
    return (records[-1].digest or "") if records else ""
