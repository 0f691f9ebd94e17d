"""Observations of other kinds that a printer's configuration holds: heights of the bed, distances.

The firmware states no σ and holds nothing out. Usual σ are put in, for the user to correct in the
file, and every third of many is kept for the test of what is identified from the others.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from campaigns.errors import ShotsInvalid, ShotsMissing
from campaigns.kinematics.model import Kinematics
from campaigns.robots.printer_config import PRINTER, PrinterConfig, SavedKind
from campaigns.shots.observations_csv import DEFAULT, ObservationRow
from campaigns.shots.shot_sets import ShotSet

BED, PART = "bed", "part"
"""Names of what is measured."""
SHRINKAGE_STD_PERCENT = 0.3
"""Usual shrinkage of printed plastic, 1 σ."""
STD_MM: dict[SavedKind, float] = {"height": 0.02, "manual_height": 0.05, "distance": 0.05}
"""Usual 1 σ of a probe, of a sheet of paper under the nozzle and of callipers, mm."""
LARGEST_OFF_MM = 20.0
"""Median distance of touches from z = 0: end stops that were measured by a ruler are nearer."""
FEWEST_HELD_OUT_OF = 9
"""Number of observations from which on some are held out: 6 heights at least are fitted."""


def printer_observations(printer: PrinterConfig, nominal: Kinematics) -> tuple[ObservationRow, ...]:
    """Return what a printer's file holds, in its order.

    Raise `ShotsMissing` for a file in which nothing was saved, and `ShotsInvalid` for touches that
    the nominal robot of the campaign has nowhere near its bed.
    """
    if not printer.saved:
        raise ShotsMissing(
            f"{printer.name}.cfg holds no heights and no distances: its block of SAVE_CONFIG has "
            "no height0_pos",
            remedy="run DELTA_CALIBRATE and SAVE_CONFIG on the printer, then copy the file again",
        )
    rows = tuple(_rows(printer))
    _check_steps(printer.name, rows, nominal)
    return rows


# Wrong steps bend the bed by a few mm alone, but put it far from where the end stops say.
def _check_steps(name: str, rows: Sequence[ObservationRow], nominal: Kinematics) -> None:
    """Raise `ShotsInvalid` if half of the touches are far from the bed of the nominal robot."""
    touches = [row for row in rows if row.kind == "height"]
    if not touches:
        return
    reached = nominal.forward(np.array([row.joints[0] for row in touches]))
    heights = np.array([row.values[0] for row in touches])
    off_mm = np.where(reached.is_solved, np.abs(reached.values[:, 2] - heights), np.inf)
    if (half_mm := float(np.median(off_mm))) > LARGEST_OFF_MM:
        raise ShotsInvalid(
            f"{name}.cfg: by robot.yaml half of the touches are {half_mm:.3g} mm or more from the "
            f"bed, limit {LARGEST_OFF_MM:g} mm",
            remedy="make the campaign with `pkmcal new DIR --robot` of this very file; look at "
            "position_endstop, and at rotation_distance, microsteps and gear_ratio, with which the "
            "bed was touched",
        )


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
            std_source=DEFAULT,
            purpose=ShotSet.VALIDATION if held_out else ShotSet.IDENTIFICATION,
            pair=str(saved.number) if is_distance else "",
            line=saved.line,
            file=f"{printer.name}{PRINTER}",
        )
