"""Costs that can be compared on a machine that others use too.

A cost is this process's own processor time: what work on one core would take with the core to
itself. Others still slow it down (they share caches and cores), so contestants take turns, and a
ratio is formed within each round.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import Generic, TypeVar

Answer = TypeVar("Answer")
Clock = Callable[[], float]
"""Gives seconds."""


@dataclass(frozen=True, slots=True)
class Run(Generic[Answer]):
    """Cost of a contestant's round, and what it found."""

    seconds: float
    answer: Answer


Contestant = Callable[[], Run[Answer]]


def timed_s(work: Callable[[], object], clock: Clock = time.process_time) -> float:
    """The cost of doing the work once."""
    began_s = clock()
    work()
    return clock() - began_s


def contestant(
    work: Callable[[], Answer], repeats: int, parts: int = 1, clock: Clock = time.process_time
) -> Contestant[Answer]:
    """Does the work some times a round; its cost is their median, for one of the work's parts."""

    def run() -> Run[Answer]:
        answers: list[Answer] = []
        costs_s = [timed_s(lambda: answers.append(work()), clock) for _ in range(repeats)]
        return Run(median(costs_s) / parts, answers[-1])

    return run


def take_turns(contestants: Sequence[Contestant[Answer]], rounds: int) -> list[list[Run[Answer]]]:
    """Each contestant's runs, in the order of the contestants."""
    by_round = [[run() for run in contestants] for _ in range(rounds)]
    return [list(runs) for runs in zip(*by_round, strict=True)]


def least_s(runs: Sequence[Run[Answer]]) -> float:
    """The cost in the round that was disturbed the least."""
    return min(run.seconds for run in runs)


def ratio(rival: Sequence[Run[Answer]], ours: Sequence[Run[Answer]]) -> tuple[float, float, float]:
    """Times as long that a rival takes: median, lowest and highest of the rounds.

    Formed within each round, where both met the same machine.
    """
    times = [theirs.seconds / own.seconds for theirs, own in zip(rival, ours, strict=True)]
    return median(times), min(times), max(times)


def medians(rounds: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Of each figure over the rounds, each a median of its own."""
    return {name: median(each[name] for each in rounds) for name in rounds[0]}
