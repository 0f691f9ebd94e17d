"""Whether the medians are as asked, in a line each what speaks against it."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Literal

from app.papers.corbel2006.comparison import Comparison
from app.papers.corbel2006.runner import Failure
from app.papers.corbel2006.tables import missed_lines

ENOUGH_SEEDS = 20
"""Of each experiment, for a median that can be relied on."""


@dataclass(frozen=True, slots=True)
class Verdict:
    """The whole in short; `seeds` is how many of each experiment were asked for."""

    decision: Literal["pass", "fail"]
    headline: str
    lines: tuple[str, ...]
    seeds: int


def verdict(comparison: Comparison, failures: Sequence[Failure], seeds: int) -> Verdict:
    """Pass only when every median that something is asked of is as asked, and no seed failed."""
    missed = tuple(missed_lines(comparison))
    asked = len(comparison.asked)
    headline = f"{asked - len(missed)} of {asked} medians are as asked."
    lines = (
        *(f"missed: {line}" for line in missed),
        *(f"failed: {line}" for line in failure_lines(failures)),
        *_about_seeds(seeds),
    )
    good = asked > 0 and not missed and not failures
    return Verdict("pass" if good else "fail", headline, lines, seeds)


def failure_lines(failures: Sequence[Failure]) -> Iterator[str]:
    """Which seeds failed, those with the same reason together."""

    def kind(failure: Failure) -> tuple[str, str]:
        return failure.trial.experiment.name, failure.reason

    in_order = sorted(failures, key=lambda failure: (*kind(failure), failure.trial.seed))
    for (experiment, reason), alike in groupby(in_order, key=kind):
        seeds = ", ".join(str(failure.trial.seed) for failure in alike)
        yield f"{experiment}, seed {seeds}: {reason}"


def _about_seeds(seeds: int) -> Iterator[str]:
    if seeds < ENOUGH_SEEDS:
        yield (
            f"{seeds} seeds of each are a look and no proof; `pkmcal reproduce` takes "
            f"{ENOUGH_SEEDS}."
        )
