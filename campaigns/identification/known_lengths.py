"""Known lengths: calibrated bars that measure the tracker's scale.

A tracker whose scale is wrong by 10 ppm gives a robot that is 10 ppm too large, and no shot of the
robot contradicts it. A bar of calibrated length does.
"""

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
    shots: Shots, bars: Sequence[KnownLengthConfig], instrument: TrackerUncertainty
) -> KnownLengths | None:
    """Return the scale by the known lengths among the shots; None if none was measured.

    Raise `ShotsInvalid` for a pair that belongs to no known length.
    """
    # Generalised least squares with a single unknown, the scale's error s: measured − calibrated
    # = s · calibrated + noise. Its variance is 1 / (l' V⁻¹ l). V holds the tracker's noise of each
    # pair and the calibration error of each bar, which is common to all pairs of that bar, so that
    # measuring one bar often does not make its calibration better.
    pairs = shots.whole_pairs(ShotSet.KNOWN_LENGTH)
    if not pairs.numbers:
        return None
    nests = shots.nests or ("",) * len(shots)
    ends = [tuple(nests[row] for row in both) for both in pairs.rows.tolist()]
    bar_of_pair = [
        _bar_of(pair, nests_of_pair, bars)
        for pair, nests_of_pair in zip(pairs.numbers, ends, strict=True)
    ]
    lengths = np.array([bars[bar].length_mm for bar in bar_of_pair])
    noise = distance_variance_mm2(
        shots.points_in_tracker_mm, shots.covariance_mm2(instrument), *pairs.rows.T
    )
    bar_std = np.array([bars[bar].std_mm for bar in bar_of_pair])
    is_same_bar = np.equal.outer(bar_of_pair, bar_of_pair)
    covariance = np.diag(noise) + is_same_bar * np.outer(bar_std, bar_std)
    residuals = shots.measured_distances_mm(pairs.rows) - lengths
    weights = np.linalg.solve(covariance, lengths)
    variance = 1.0 / float(lengths @ weights)
    scale = variance * float(weights @ residuals)
    # What one scale for all pairs does not explain: bars that contradict each other.
    unexplained = residuals - scale * lengths
    chi2 = float(unexplained @ np.linalg.solve(covariance, unexplained))
    p = float(scipy.special.chdtrc(len(unexplained) - 1, chi2)) if len(unexplained) > 1 else 1.0
    findings = []
    if p < SCATTER_LEVEL:
        worst = int(np.abs(residuals / np.sqrt(np.diag(covariance))).argmax())
        says = (
            f"the known lengths contradict each other (p = {p:.1g}): "
            f"{bars[bar_of_pair[worst]].name}, pair {pairs.numbers[worst]}, is off by "
            f"{residuals[worst]:+.3f} mm: measure them again, or correct known_lengths in "
            "campaign.yaml"
        )
        findings.append(Finding(KNOWN_LENGTH, says, "fail", {"p": p}))
    unmeasured = [bar.name for place, bar in enumerate(bars) if place not in bar_of_pair]
    if unmeasured:
        which = ", ".join(unmeasured)
        says = f"of known_lengths {which} was not measured: the scale is determined without it"
        findings.append(Finding("unmeasured-length", says))
    return KnownLengths((scale, variance**0.5), tuple(findings))


def _bar_of(pair: int, nests: tuple[str, ...], bars: Sequence[KnownLengthConfig]) -> int:
    """Return the place of the known length that a pair was measured at."""
    place = bar_of(bars, pair, nests)
    if place is None:
        raise ShotsInvalid(
            f"pair {pair} of the set known-length belongs to no length of known_lengths",
            remedy="name it in campaign.yaml, known_lengths, or leave its rows out",
        )
    return place
