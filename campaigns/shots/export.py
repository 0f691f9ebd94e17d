"""A journal's shots as rows of shots.csv, for other software and for another campaign."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from campaigns.files.shot_columns import SHOTS_OF_A_PAIR
from campaigns.journal.views import AcceptedShot, Series
from campaigns.shot_sets import ShotSet
from campaigns.shots.exchange import ShotRow
from campaigns.shots.import_note import noted


@dataclass(frozen=True, slots=True)
class ExportedShots:
    """Rows by shot number, and the numbers of what was left out."""

    rows: tuple[ShotRow, ...]
    halves: tuple[int, ...]
    """Shots whose pair has no second one: the file's readers refuse half a pair."""


def exported_shots(series: Series, shots: Sequence[AcceptedShot]) -> ExportedShots:
    """Turn a series' accepted shots into rows, whole pairs only.

    θ is that of the commanded pose; an import knows none.
    """
    sizes = Counter(shot.intent.pair for shot in shots)
    lone = {pair for pair, size in sizes.items() if pair is not None and size < SHOTS_OF_A_PAIR}
    whole = [shot for shot in shots if shot.intent.pair not in lone]
    halves = tuple(shot.intent.shot for shot in shots if shot.intent.pair in lone)
    is_import = series.started.stage == "import"
    return ExportedShots(tuple(_row(shot, is_import=is_import) for shot in whole), halves)


def _row(shot: AcceptedShot, *, is_import: bool) -> ShotRow:
    intent, outcome = shot.intent, shot.outcome
    air = None if outcome.weather is None else outcome.weather.temperature_degC
    time: str | None = shot.measured_utc
    if is_import:  # the journal's own time is that of the import
        air, time = noted(outcome.raw_tracker)
    return ShotRow(
        pair=intent.pair,
        joints_rad=outcome.joints_rad,
        point_in_tracker_mm=outcome.point_in_tracker_mm,
        purpose=ShotSet(intent.purpose),
        theta_rad=None if is_import else intent.target.theta_rad,
        covariance_mm2=outcome.covariance_mm2,
        temperature_degC=air,
        time=time,
    )
