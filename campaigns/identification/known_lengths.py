"""Known lengths: pairs of points on calibrated bars, and what they say of the tracker's scale."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from campaigns.arrays import Array
from campaigns.errors import ShotsInvalid
from campaigns.estimation.information import TrackerScale
from campaigns.estimation.tracker_noise import TrackerUncertainty, distance_variance_mm2
from campaigns.evaluation.diagnostics import Doubt, scale_doubt, unmeasured_told
from campaigns.settings.sections import KnownLengthConfig, bar_of
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots


@dataclass(frozen=True, slots=True)
class MeasuredKnownLength:
    """Known length as a pair of points measured it, mm."""

    name: str
    pair: int
    known_mm: float
    measured_mm: float
    residual_mm: float
    """Measured minus known."""
    std_mm: float
    """Of the residual, by the tracker's noise and by what is known of the bar."""


@dataclass(frozen=True, slots=True)
class KnownLengths:
    """All of them, and the tracker's scale by them."""

    lengths: tuple[MeasuredKnownLength, ...]
    scale: TrackerScale


def known_lengths(
    shots: Shots, known: Sequence[KnownLengthConfig], instrument: TrackerUncertainty
) -> KnownLengths | None:
    """Known lengths among the shots; None without any.

    Raises `ShotsInvalid` for a pair that no known length claims.
    """
    pairs = shots.whole_pairs(ShotSet.KNOWN_LENGTH)
    if not pairs.numbers:
        return None
    nests = shots.nests or ("",) * len(shots)
    ends = [tuple(nests[row] for row in both) for both in pairs.rows.tolist()]
    bars = [_bar_of(*each, known) for each in zip(pairs.numbers, ends, strict=True)]
    lengths_mm = np.array([known[bar].length_mm for bar in bars])
    measured_mm = shots.measured_distances_mm(pairs.rows)
    covariance_mm2 = np.diag(
        distance_variance_mm2(
            shots.points_in_tracker_mm, shots.covariance_mm2(instrument), *pairs.rows.T
        )
    )
    bar_std_mm = np.array([known[bar].std_mm for bar in bars])
    of_one_bar = np.equal.outer(bars, bars)  # its own error is in all of its measurements
    covariance_mm2 = covariance_mm2 + of_one_bar * np.outer(bar_std_mm, bar_std_mm)
    std_mm: Array = np.sqrt(np.diag(covariance_mm2))
    residuals_mm = measured_mm - lengths_mm
    rows = zip(
        [known[bar].name for bar in bars],
        pairs.numbers,
        *(each.tolist() for each in (lengths_mm, measured_mm, residuals_mm, std_mm)),
        strict=True,
    )
    scale = TrackerScale.of(residuals_mm, lengths_mm, covariance_mm2, instrument.scale)
    return KnownLengths(tuple(MeasuredKnownLength(*row) for row in rows), scale)


def known_length_doubts(
    found: KnownLengths | None, known: Sequence[KnownLengthConfig]
) -> Iterator[Doubt]:
    """Doubts where chance and the data sheet do not explain them, and where nobody measured one."""
    measured = {each.name for each in found.lengths} if found else set[str]()
    if unmeasured := [bar.name for bar in known if bar.name not in measured]:
        yield unmeasured_told(unmeasured)
    if found is not None and not found.scale.believable:
        worst = max(found.lengths, key=lambda each: abs(each.residual_mm / each.std_mm))
        says = f"{worst.name}, pair {worst.pair}, is off by {worst.residual_mm:+.3f} mm"
        yield scale_doubt(found.scale, says)


def _bar_of(pair: int, nests: tuple[str, ...], known: Sequence[KnownLengthConfig]) -> int:
    """Place of the known length that a pair was measured at."""
    place = bar_of(known, pair, nests)
    if place is not None:
        return place
    raise ShotsInvalid(
        f"pair {pair} is of the set known-length, but known_lengths in campaign.yaml does not say "
        "which length it is",
        remedy="give name, length_mm and std_mm there, and the pair's number under pairs",
    )
