"""Observations of other kinds that a printer's configuration holds: heights of the bed, distances.

The firmware states no σ and holds nothing out. Usual σ are put in, for the user to correct in the
file, and every third of many is kept for the test of what is identified from the others.
"""

from collections.abc import Iterator

from campaigns.errors import ShotsMissing
from campaigns.robots.printer_config import PrinterConfig, SavedKind
from campaigns.shots.observations_csv import ObservationRow
from campaigns.shots.shot_sets import ShotSet

BED, PART = "bed", "part"
"""Names of what is measured."""
SHRINKAGE_STD_PERCENT = 0.3
"""Usual shrinkage of printed plastic, 1 σ."""
STD_MM: dict[SavedKind, float] = {"height": 0.02, "manual_height": 0.05, "distance": 0.05}
"""Usual 1 σ of a probe, of a sheet of paper under the nozzle and of callipers, mm."""
FEWEST_HELD_OUT_OF = 9
"""Number of observations from which on some are held out: 6 heights at least are fitted."""


def printer_observations(printer: PrinterConfig) -> tuple[ObservationRow, ...]:
    """Return what a printer's file holds, in its order.

    Raise `ShotsMissing` for a file in which nothing was saved.
    """
    if not printer.saved:
        raise ShotsMissing(
            f"{printer.name}.cfg holds no heights and no distances: its block of SAVE_CONFIG has "
            "no height0_pos",
            remedy="run DELTA_CALIBRATE and SAVE_CONFIG on the printer, then copy the file again",
        )
    return tuple(_rows(printer))


def _rows(printer: PrinterConfig) -> Iterator[ObservationRow]:
    """Yield the observations; every third of a kind is of the set validation if there are many."""
    kinds = [saved.kind for saved in printer.saved]
    for saved in printer.saved:
        many = kinds.count(saved.kind) >= FEWEST_HELD_OUT_OF
        held_out = many and saved.number % 3 == 2
        is_distance = saved.kind == "distance"
        yield ObservationRow(
            kind="distance" if is_distance else "height",
            object=PART if is_distance else BED,
            joints=saved.joints_mm,
            values=(saved.value_mm,),
            std_mm=STD_MM[saved.kind],
            purpose=ShotSet.VALIDATION if held_out else ShotSet.IDENTIFICATION,
            pair=str(saved.number) if is_distance else "",
        )
