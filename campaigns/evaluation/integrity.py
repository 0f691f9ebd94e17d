"""Integrity: whether a campaign's files still belong together, as an auditor would check it."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Check:
    """Statement about the files, and whether it holds; None: there is nothing to compare."""

    statement: str
    holds: bool | None
    detail: str
    decides: bool = True
    """Whether nothing can pass when it does not hold."""


def same_digest(statement: str, one: str | None, other: str | None) -> Check:
    """Check that two digests agree."""
    if not one or not other:
        return Check(statement, None, "nothing to compare")
    if one == other:
        return Check(statement, holds=True, detail=f"sha256 {one[:16]}…")
    return Check(statement, holds=False, detail=f"sha256 {one[:16]}… is not {other[:16]}…")
