"""Known lengths: calibrated bars that measure the tracker's scale."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import special

from campaigns.errors import ShotsInvalid
from campaigns.fit.tracker_noise import TrackerUncertainty, distance_variance_mm2
from campaigns.identification.findings import KNOWN_LENGTH, Finding
from campaigns.settings.sections import KnownLengthConfig, bar_of
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots

SCATTER_LEVEL = 1e-3
"""Probability of a larger χ² below which known lengths contradict each other."""


@dataclass(frozen=True, slots=True)
class MeasuredLength:
    """Known length as a pair of points measured it, mm; the residual is measured minus known."""

    name: str
    pair: int
    known_mm: float
    measured_mm: float
    residual_mm: float
    std_mm: float
    """1 σ of the residual, by the tracker's noise and the bar's certificate."""


@dataclass(frozen=True, slots=True)
class KnownLengths:
    """Measured lengths, and the tracker's scale by them."""

    lengths: tuple[MeasuredLength, ...]
    scale: tuple[float, float]
    """Error of the scale, a ratio, and its 1 σ."""
    p: float
    """Probability of a larger χ² of the lengths about that scale."""
    unmeasured: tuple[str, ...] = ()

    def findings(self) -> Iterator[Finding]:
        """Yield a finding where lengths contradict each other, or none of a bar was measured."""
        if self.p < SCATTER_LEVEL:
            worst = max(self.lengths, key=lambda own: abs(own.residual_mm / own.std_mm))
            says = (
                f"the known lengths contradict each other (p = {self.p:.1g}): {worst.name}, pair "
                f"{worst.pair}, is off by {worst.residual_mm:+.3f} mm: measure them again, or "
                "correct known_lengths in campaign.yaml"
            )
            yield Finding(KNOWN_LENGTH, says, "fail", {"p": self.p})
        if self.unmeasured:
            which = ", ".join(self.unmeasured)
            says = f"of known_lengths {which} was not measured: it tells nothing of the scale"
            yield Finding("unmeasured-length", says)


def known_lengths(
    shots: Shots, known: Sequence[KnownLengthConfig], instrument: TrackerUncertainty
) -> KnownLengths | None:
    """Return the known lengths among the shots; None if none was measured.

    Raise `ShotsInvalid` for a pair that no known length claims.
    """
    pairs = shots.whole_pairs(ShotSet.KNOWN_LENGTH)
    if not pairs.numbers:
        return None
    nests = shots.nests or ("",) * len(shots)
    ends = [tuple(nests[row] for row in both) for both in pairs.rows.tolist()]
    bars = [_bar_of(pair, own, known) for pair, own in zip(pairs.numbers, ends, strict=True)]
    lengths = np.array([known[bar].length_mm for bar in bars])
    measured = shots.measured_distances_mm(pairs.rows)
    noise = distance_variance_mm2(
        shots.points_in_tracker_mm, shots.covariance_mm2(instrument), *pairs.rows.T
    )
    bar_std = np.array([known[bar].std_mm for bar in bars])
    same_bar = np.equal.outer(bars, bars)  # a bar's own error is in all of its measurements
    covariance = np.diag(noise) + same_bar * np.outer(bar_std, bar_std)
    residuals = measured - lengths
    weights = np.linalg.solve(covariance, lengths)
    variance = 1.0 / float(lengths @ weights)
    share = variance * float(weights @ residuals)
    left = residuals - share * lengths
    chi2 = float(left @ np.linalg.solve(covariance, left))
    p = float(special.chdtrc(len(left) - 1, chi2)) if len(left) > 1 else 1.0
    std = np.sqrt(np.diag(covariance))
    rows = zip(
        [known[bar].name for bar in bars],
        pairs.numbers,
        *(values.tolist() for values in (lengths, measured, residuals, std)),
        strict=True,
    )
    names = {known[bar].name for bar in bars}
    unmeasured = tuple(bar.name for bar in known if bar.name not in names)
    return KnownLengths(
        tuple(MeasuredLength(*row) for row in rows), (share, variance**0.5), p, unmeasured
    )


def _bar_of(pair: int, nests: tuple[str, ...], known: Sequence[KnownLengthConfig]) -> int:
    """Return the place of the known length that a pair was measured at."""
    place = bar_of(known, pair, nests)
    if place is None:
        raise ShotsInvalid(
            f"pair {pair} of the set known-length belongs to no length of known_lengths",
            remedy="name it in campaign.yaml, known_lengths, or leave its rows out",
        )
    return place
