"""Errors of shots and pairs in groups, each with a mark of its own."""

from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array
from campaigns.evaluation.model_errors import Residuals
from campaigns.evidence import Evaluation


@dataclass(frozen=True, slots=True, eq=False)
class PairGroup:
    """Errors of a group of pairs, mm; a stage that was not measured is None."""

    name: str
    marker: str
    before_mm: Array | None
    after_mm: Array | None
    numbers: tuple[int, ...] = ()
    """Of the pairs or shots; () where nobody numbers them."""

    def __len__(self) -> int:
        return max(len(e) for e in (self.before_mm, self.after_mm) if e is not None)


def shot_group(shots: Residuals) -> PairGroup:
    """Lengths of the errors of fitted shots."""
    assert shots.after_mm is not None, "they were fitted"
    group = error_group("fitted shots", "o", shots.before_mm, shots.after_mm)
    return replace(group, numbers=shots.numbers)


def pair_groups(found: Evaluation) -> tuple[PairGroup, ...]:
    """Fitted and hold-out pairs by the models, and the pairs that the controller was told."""
    errors, stages = found.errors, (found.before, found.after)
    modelled = (
        ("fitted pairs", "o", errors.fitted if errors else None),
        ("hold-out pairs", "D", errors.unseen if errors else None),
    )
    groups = [
        PairGroup(name, marker, pairs.before_mm, pairs.after_mm, pairs.numbers)
        for name, marker, pairs in modelled
        if pairs is not None
    ]
    tests = [stage.distances if stage else None for stage in stages]
    if any(tests):
        old, new = (test.errors_mm if test else None for test in tests)
        numbers = {test.pairs for test in tests if test}
        each = numbers.pop() if len(numbers) == 1 else ()
        groups.append(PairGroup("commanded pairs", "s", old, new, each))
    return tuple(groups)


def error_group(name: str, marker: str, *errors: Array) -> PairGroup:
    """Group of distances (N, 1) with their sign, or of positions (N, 3) by their length."""
    before, after = (
        each[:, 0] if each.shape[1] == 1 else np.linalg.norm(each, axis=1) for each in errors
    )
    return PairGroup(name, marker, before, after)
