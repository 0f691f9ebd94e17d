"""Test of hold-out pairs, as results hold it."""

from dataclasses import dataclass

HOLD_OUT_LEVEL = 1e-3
"""Probability of a larger χ² of hold-out pairs below which their errors contradict σ."""


@dataclass(frozen=True, slots=True)
class HoldOut:
    """Test of pairs that were never fitted, by their distances."""

    pairs: int
    chi2: float
    p: float
    ratio: float
    """Rms of their errors over the rms that the posterior states."""

    @property
    def believable(self) -> bool:
        """Whether chance explains their errors."""
        return self.p >= HOLD_OUT_LEVEL

    @property
    def applied_ratio(self) -> float:
        """Factor of σ of positions: 1 while chance explains the errors."""
        return 1.0 if self.believable else max(1.0, self.ratio)
