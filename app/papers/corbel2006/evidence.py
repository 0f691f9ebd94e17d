"""Why ours differs from the paper, in numbers."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from app.papers.corbel2006 import printed
from app.papers.corbel2006.comparison import of_experiment
from app.papers.corbel2006.experiments import PROTOTYPE
from app.papers.corbel2006.floors import SEED, Floor, floors
from app.papers.corbel2006.geometry_alone import GeometryAlone, geometry_alone
from app.papers.corbel2006.misfit import Reach, reaches
from app.papers.corbel2006.trials import TrialResult
from campaigns.arrays import Array

PERCENT = 100.0


@dataclass(frozen=True, slots=True, eq=False)
class PairLengths:
    """Validation pairs of all seeds before calibration, (M,) each, mm."""

    lengths_mm: Array
    errors_mm: Array
    """Without signs."""

    @classmethod
    def of(cls, results: Sequence[TrialResult]) -> "PairLengths":
        """Those of seeds of the prototype."""
        return cls(
            np.concatenate([result.before.lengths_mm for result in results]),
            np.abs(np.concatenate([result.before.errors_mm for result in results])),
        )

    @property
    def share(self) -> float:
        """Mean error in mean distances."""
        return float(self.errors_mm.mean() / self.lengths_mm.mean())

    def length_for_mm(self, error_mm: float) -> float:
        """How long a pair is on average with that error."""
        return error_mm / self.share

    def in_words(self) -> str:
        """What the pairs say about the paper's."""
        paper = (printed.MEAN_BEFORE, printed.MAX_BEFORE)
        mean_mm, max_mm = (self.length_for_mm((p.low + p.high) / 2.0) for p in paper)
        return (
            f"Before calibration a commanded distance is off by {PERCENT * self.share:.1f} % of "
            f"itself on average: four joint offsets of about the same size make every motion too "
            f"short. Our pairs are {self.lengths_mm.mean():.0f} mm apart on average, and "
            f"{self.lengths_mm.max():.0f} mm at most. The paper's 7.3 and 15.2 mm belong to pairs "
            f"of about {mean_mm:.0f} and {max_mm:.0f} mm."
        )


@dataclass(frozen=True, slots=True, eq=False)
class Evidence:
    """All of it; what rests on seeds of the prototype is None or empty without one."""

    floors: tuple[Floor, ...]
    reaches: tuple[Reach, ...]
    pairs: PairLengths | None
    geometry_alone: tuple[GeometryAlone, ...]


def evidence(results: Sequence[TrialResult]) -> Evidence:
    """Draw and compute it."""
    own = of_experiment(results, PROTOTYPE.name)
    rng = np.random.default_rng(SEED)
    return Evidence(
        floors(rng),
        reaches(),
        PairLengths.of(own) if own else None,
        geometry_alone(own, rng) if own else (),
    )
