"""Chain of digests over a journal's records: what was changed, renumbered or taken out shows."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass

from campaigns.errors import JournalFailed

FROM_BACKUP = "move campaign.db and campaign.db-wal away, and bring campaign.db back from a backup"

Content = tuple[int, str, str, int | None, int | None, int | None, str]
"""A record as stored: number, at_utc, kind, series, shot, attempt, body."""
Row = tuple[int, str, str, int | None, int | None, int | None, str, str | None]
"""The same with its digest; None of a record from before there were any."""


@dataclass(frozen=True, slots=True)
class ChainEnd:
    """Last record of a journal, and the digest that all records up to it lead to."""

    number: int
    digest: str


EMPTY = ChainEnd(0, "")
_JSON = json.JSONEncoder(ensure_ascii=False)
"""Made once: `json.dumps` makes one for each record."""


class JournalDamaged(JournalFailed):
    """A journal that is not what was written; `number` is the first record concerned, if known.

    `whole` are the records before it where it is the last one.
    """

    def __init__(
        self, problem: str, *, number: int | None = None, whole: Sequence[Row] = ()
    ) -> None:
        kept = f"`pkmcal run` keeps the {len(whole)} records before it in a copy; or "
        super().__init__(problem, remedy=f"{kept if whole else ''}{FROM_BACKUP}")
        self.number, self.whole = number, whole


def as_json(values: Sequence[str | int | None]) -> bytes:
    """Bytes of a record's values as digests take them; raises as `digest_after` does."""
    return _JSON.encode(values).encode()


def digest_after(before: str, content: Content) -> str:
    """SHA-256 (hex) of a record and of the digest of the one before it, "" before the first.

    Raises `TypeError` for what is neither text nor number, `ValueError` for what is no Unicode.
    """
    return hashlib.sha256(as_json([before, *content])).hexdigest()


def chain_end(rows: Sequence[Row], stated: ChainEnd = EMPTY) -> ChainEnd:
    """End of the chain over all records, in the order of their numbers.

    Records without a digest may only come first: the first digest after them covers them too.
    `stated` is the last record that has a digest, as the file itself says. Raises `JournalDamaged`.
    """
    end = sealed = EMPTY
    for row in rows:
        end = _next_end(end, row, sealed)
        sealed = end if row[-1] is not None else sealed
    if sealed.number < stated.number:
        first = end.number + 1
        raise JournalDamaged(
            f"the records from {first} to {stated.number} are missing", number=first
        )
    if sealed != stated:
        problem = f"record {end.number} is not the last one that was written"
        raise JournalDamaged(problem, number=end.number)
    return end


def _next_end(end: ChainEnd, row: Row, sealed: ChainEnd) -> ChainEnd:
    number, due, stored = row[0], end.number + 1, row[-1]
    if number != due:
        problem = f"record {due} is missing or was renumbered: {number} comes next"
        raise JournalDamaged(problem, number=due)
    try:
        digest = digest_after(end.digest, row[:-1])
    except UnicodeEncodeError:
        problem = f"record {number} holds text that is no UTF-8"
        raise JournalDamaged(problem, number=number) from None
    except (TypeError, ValueError) as error:
        problem = f"record {number} holds what none may hold: {error}"
        raise JournalDamaged(problem, number=number) from error
    if stored is None and sealed != EMPTY:
        problem = f"record {number} has no digest, though those before it have one"
        raise JournalDamaged(problem, number=number)
    if stored is not None and stored != digest:
        first = sealed.number + 1
        which = f"record {number}" if first == number else f"one of the records {first} to {number}"
        raise JournalDamaged(f"{which} was changed after it was written", number=first)
    return ChainEnd(number, digest)
