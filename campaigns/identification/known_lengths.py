"""Known lengths: calibrated bars that measure the tracker's scale."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from campaigns.errors import ShotsInvalid
from campaigns.fit.tracker_noise import TrackerUncertainty, distance_variance_mm2
from campaigns.identification.findings import KNOWN_LENGTH, Finding
from campaigns.settings.sections import KnownLengthConfig, bar_of
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots

SCATTER_LEVEL = 1e-3
"""Probability of a larger χ² below which known lengths contradict each other."""


@dataclass(frozen=True, slots=True)
class KnownLengths:
    """Tracker's scale by known lengths, and what contradicts them."""

    scale: tuple[float, float]
    """Error of the scale, a ratio, and its 1 σ."""
    findings: tuple[Finding, ...]


def known_lengths(
    shots: Shots, known: Sequence[KnownLengthConfig], instrument: TrackerUncertainty
) -> KnownLengths | None:
    """Return what the known lengths among the shots show; None if none was measured.

    Raise `ShotsInvalid` for a pair that no known length claims.
    """
    pairs = shots.whole_pairs(ShotSet.KNOWN_LENGTH)
    if not pairs.numbers:
        return None
    nests = shots.nests or ("",) * len(shots)
    ends = [tuple(nests[row] for row in both) for both in pairs.rows.tolist()]
    bars = [_bar_of(pair, own, known) for pair, own in zip(pairs.numbers, ends, strict=True)]
    lengths = np.array([known[bar].length_mm for bar in bars])
    noise = distance_variance_mm2(
        shots.points_in_tracker_mm, shots.covariance_mm2(instrument), *pairs.rows.T
    )
    bar_std = np.array([known[bar].std_mm for bar in bars])
    same_bar = np.equal.outer(bars, bars)  # a bar's own error is in all of its measurements
    covariance = np.diag(noise) + same_bar * np.outer(bar_std, bar_std)
    residuals = shots.measured_distances_mm(pairs.rows) - lengths
    weights = np.linalg.solve(covariance, lengths)
    variance = 1.0 / float(lengths @ weights)
    share = variance * float(weights @ residuals)
    unexplained = residuals - share * lengths
    chi2 = float(unexplained @ np.linalg.solve(covariance, unexplained))
    p = float(scipy.special.chdtrc(len(unexplained) - 1, chi2)) if len(unexplained) > 1 else 1.0
    findings = []
    if p < SCATTER_LEVEL:
        worst = int(np.abs(residuals / np.sqrt(np.diag(covariance))).argmax())
        says = (
            f"the known lengths contradict each other (p = {p:.1g}): {known[bars[worst]].name}, "
            f"pair {pairs.numbers[worst]}, is off by {residuals[worst]:+.3f} mm: measure them "
            "again, or correct known_lengths in campaign.yaml"
        )
        findings.append(Finding(KNOWN_LENGTH, says, "fail", {"p": p}))
    if unmeasured := [bar.name for place, bar in enumerate(known) if place not in bars]:
        which = ", ".join(unmeasured)
        says = f"of known_lengths {which} was not measured: it tells nothing of the scale"
        findings.append(Finding("unmeasured-length", says))
    return KnownLengths((share, variance**0.5), tuple(findings))


def _bar_of(pair: int, nests: tuple[str, ...], bars: Sequence[KnownLengthConfig]) -> int:
    """Return the place of the known length that a pair was measured at."""
    place = bar_of(bars, pair, nests)
    if place is None:
        raise ShotsInvalid(
            f"pair {pair} of the set known-length belongs to no length of known_lengths",
            remedy="name it in campaign.yaml, known_lengths, or leave its rows out",
        )
    return place
