"""Sources of the figures that a verdict rests on, at the moment of measuring.

What counts for a series, and for an observation, is what was recorded when it was measured or
imported. campaign.yaml may say something else later, which is named beside the verdict and has no
effect. A file that is imported again takes what is stated by then; but its figures were there to be
looked at, so that an uncertainty could be chosen by them. So what the first record of a measurement
states counts, whatever source is named later: with a smaller one nothing passes.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from campaigns.arrays import Array
from campaigns.evaluation.verdict import Check
from campaigns.journal.records import SeriesStarted
from campaigns.journal.views import AcceptedShot, Series
from campaigns.kinematics.mechanism import Mechanism
from campaigns.settings.instrument import NamedInstruments, StatedInstrument
from campaigns.shots.import_export import FILE_DECIMALS
from campaigns.shots.observation_records import RestatedStd
from campaigns.shots.shots import shots_of_journal
from drivers.texts import moment

ShotPairs = list[tuple[AcceptedShot, AcceptedShot]]
"""Shots of one measurement: as it was recorded first, and as it is recorded now."""
SMALLER = 1e-3
"""Share of a point's variance that the next import may state less: files round covariances."""
REMEDY = "what was stated first counts: import them with it, or measure anew"


@dataclass(frozen=True, slots=True)
class SeriesSources:
    """Series of a journal with what their records state of the instruments.

    Attributes:
        counted: Series that the verdict rests on.
        every: All series, in the order of their beginning.
        mechanism: Mechanism of the robot.
        instrument_of: Gives the tracker's limits that count for a series.
    """

    counted: Sequence[Series]
    every: Sequence[Series]
    mechanism: Mechanism
    instrument_of: Callable[[SeriesStarted], StatedInstrument]

    def changed_later(self, limits: StatedInstrument, names: NamedInstruments) -> Iterator[Check]:
        """Yield a check for each later change of limits and names, by those of campaign.yaml now.

        None of them decides: what was recorded with the series counts.
        """
        # Only points without an uncertainty of their own rest on the limits of the noise, but all
        # rest on the limits of what shots have in common. So any change is named.
        of_limits, of_names = dict[str, list[str]](), dict[str, list[str]]()
        for series in self.counted:
            started, number = series.started, str(series.number)
            if changed := self.instrument_of(started).difference(limits):
                of_limits.setdefault(changed, []).append(number)
            for changed in names.recorded(started).difference(names):
                of_names.setdefault(changed, []).append(number)
        for what, changes in (("tracker's uncertainty", of_limits), ("instruments", of_names)):
            for changed, numbers in changes.items():
                yield Check(
                    f"campaign.yaml states the {what} as when series {', '.join(numbers)} came "
                    "into the journal",
                    holds=False,
                    detail=f"{changed}; the former counts",
                    decides=False,
                )

    def restated(self) -> Iterator[Check]:
        """Yield a check for each counted import of points that an earlier series has with more."""
        for series in self.counted:
            if not series.started.imported:
                continue
            for earlier, shots in self._first_records(series):
                if smaller := self._smaller(series, earlier, shots):
                    yield _restated(
                        f"series {series.number}",
                        f"of {moment(series.started_utc)} it has points of series "
                        f"{earlier.number} of {moment(earlier.started_utc)}, with less: {smaller}",
                    )

    def _first_records(self, series: Series) -> Iterator[tuple[Series, ShotPairs]]:
        """Yield earlier series that have points of a series first, with both shots of each."""
        to_find = {_point_of(shot): shot for shot in series.shots}
        for earlier in self.every:
            if earlier.number >= series.number:
                return
            points = {_point_of(shot): shot for shot in earlier.shots}
            common = [point for point in points if point in to_find]
            if common:
                yield earlier, [(points[point], to_find.pop(point)) for point in common]

    def _smaller(self, series: Series, earlier: Series, shots: ShotPairs) -> str:
        """Return which uncertainty of a series' points is less than an earlier one's, in words."""
        # A covariance that is less in any direction makes the U of some figure smaller.
        then_mm2 = self._stated([then for then, _ in shots], earlier)
        now_mm2 = self._stated([now for _, now in shots], series)
        changes, directions = np.linalg.eigh(now_mm2 - then_mm2)  # the largest loss comes first
        lost = changes[:, 0] < -SMALLER * np.trace(then_mm2, axis1=1, axis2=2)
        instrument = self.instrument_of(series.started)
        smaller = [*instrument.smaller_of_all(self.instrument_of(earlier.started))]
        if lost.any():
            place = int(np.argmin(changes[:, 0]))
            along = directions[place, :, 0]
            then, now = (np.sqrt(along @ mm2[place] @ along) for mm2 in (then_mm2, now_mm2))
            smaller.append(f"u of {lost.sum()} points, for one {then:.4f} → {now:.4f} mm")
        return ", ".join(smaller)

    def _stated(self, shots: Sequence[AcceptedShot], series: Series) -> Array:
        """Return the covariances of points (N, 3, 3) as they count for a series, mm²."""
        # whatever an object on the platform carries, here it is a point
        on_robot = [replace(shot, intent=replace(shot.intent, reflector="")) for shot in shots]
        measured = shots_of_journal(on_robot, self.mechanism)
        return measured.covariance_mm2(self.instrument_of(series.started).uncertainty)


def restated_observations(restated: Sequence[RestatedStd]) -> Iterator[Check]:
    """Yield a check for each file of observations of which the first record states a larger σ."""
    for changed in restated:
        yield _restated(
            f"{changed.count} observations in {changed.file}",
            f"{moment(changed.at_utc)} the file states σ {changed.now_mm:g} mm where "
            f"{changed.earlier} of {moment(changed.earlier_utc)} has {changed.then_mm:g} mm",
        )


def _restated(whose: str, detail: str) -> Check:
    return Check(
        f"the uncertainty of {whose} is what was stated of the measurement first",
        holds=False,
        detail=f"{detail}; {REMEDY}",
    )


def _point_of(shot: AcceptedShot) -> tuple[float, ...]:
    """Return a shot's point to the digits that files have."""
    return tuple(round(value, FILE_DECIMALS) for value in shot.outcome.point_in_tracker_mm)
