"""What both summaries of a study say alike: labels, tables, shortcomings, words of a document."""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import Any

from app.study.running import Studied

NAMED = 3
"""Parameters whose σ is wrong, and failures, that are named in a line."""
PERCENT = 100.0


def labels_of(words: Sequence[tuple[str, ...]]) -> list[str]:
    """Labels of what is told by several words each, without those that all have in common."""
    differing = [place for place, each in enumerate(zip(*words, strict=True)) if len(set(each)) > 1]
    return [" · ".join(each[place] for place in differing or range(len(each))) for each in words]


def common_document(one: Studied) -> dict[str, Any]:
    """What the document says of any combination."""
    table = one.combination.table
    assert table.head is not None, "every study's table has one"
    return {
        **one.combination.words,
        "study": table.head["study"],
        "lost": one.lost,
        "computed": one.computed,
        "path": str(table.path),
    }


def shortcomings(one: Studied) -> Iterator[str]:
    """How many campaigns ended without an answer, or never came back; why, and what next."""
    reasons = Counter(row.failure for row in one.rows if row.failure)
    if reasons:
        worded = "; ".join(f"{count} × {reason}" for reason, count in reasons.most_common(NAMED))
        yield f"{sum(reasons.values())} campaigns without an answer: {worded}"
    if one.lost:
        told = "; ".join(one.reasons[:NAMED])
        yield f"{one.lost} campaigns lost: {told} → the same command tries them again"
