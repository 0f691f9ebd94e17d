"""Match of a plan with what was measured by it: shot by shot, whatever rows came or went since."""

from collections.abc import Iterable, Sequence
from itertools import zip_longest

import numpy as np

from campaigns.journal.records import Intent
from campaigns.planning.plan_file import PlannedShot

POSITION = 3
"""Coordinates in mm, before those of a turn."""
SAME_MM = 1e-3
SAME_RAD = 1e-5
"""Rounding of plan.csv and of a pose's joints is far below, another pose far above."""


def plan_difference(measured: Iterable[Intent], planned: Sequence[PlannedShot]) -> str:
    """First shot that was measured as another one than the plan has, in words; empty when none was.

    Rows that were taken out since, or added, make no difference, as long as one is left.
    """
    rows = {shot.shot: shot for shot in planned}
    intents = list(measured)
    common = [intent for intent in intents if intent.shot in rows]
    if intents and not common:
        return "none of its shots is in plan.csv any more"
    for intent in common:
        row = rows[intent.shot]
        if (intent.purpose, intent.pair, intent.nest) != (row.purpose.value, row.pair, row.nest):
            return (
                f"shot {intent.shot} was measured for another set, pair or nest than plan.csv has "
                "now"
            )
        if not _is_same(intent, row):
            return f"shot {intent.shot} was measured at another pose than plan.csv has now"
    return ""


def _is_same(intent: Intent, row: PlannedShot) -> bool:
    if len(intent.target_joints) != len(row.joints):
        return False
    both = zip_longest(intent.target.coordinates, row.pose.coordinates, fillvalue=0.0)
    apart, turned = np.split(np.abs([measured - planned for measured, planned in both]), [POSITION])
    near = apart.max() <= SAME_MM and turned.max(initial=0.0) <= SAME_RAD
    return bool(near and np.abs(np.subtract(intent.target_joints, row.joints)).max() <= SAME_RAD)
