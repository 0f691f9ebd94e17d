"""A journal's shots as rows of shots.csv, for other software and for another campaign."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass

from campaigns.files.shot_columns import SHOTS_OF_A_PAIR
from campaigns.journal.views import AcceptedShot, Series
from campaigns.shot_sets import ShotSet
from campaigns.shots.exchange import ShotRow
from campaigns.shots.importing import UNKNOWN

MEASURED = f"{UNKNOWN}, measured "
"""What stands before the time that an imported shot came with."""


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
    return ShotRow(
        pair=intent.pair,
        joints_rad=outcome.joints_rad,
        point_in_tracker_mm=outcome.point_in_tracker_mm,
        purpose=ShotSet(intent.purpose),
        theta_rad=None if is_import else intent.target.theta_rad,
        covariance_mm2=outcome.covariance_mm2,
        temperature_degC=None if outcome.weather is None else outcome.weather.temperature_degC,
        time=_imported_time(outcome.raw_tracker) if is_import else shot.measured_utc,
    )


def _imported_time(raw_tracker: str) -> str | None:
    """The time that the imported file gave: the journal's own is that of the import."""
    found = raw_tracker.removeprefix(MEASURED)
    return None if found == raw_tracker else found
