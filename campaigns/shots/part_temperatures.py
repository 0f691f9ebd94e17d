"""Temperatures of a robot's parts, by which these grow."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from campaigns.errors import ShotsInvalid
from campaigns.shots.shots import Shots
from campaigns.shots.shots_csv import times_s


def with_readings(shots: Shots, readings: Mapping[str, float]) -> Shots:
    """Fill in temperatures of parts from readings at times, °C, where shots have none.

    Between two readings in proportion to time. Raise `ShotsInvalid` for times of another kind.
    """
    if not readings:
        return shots
    seconds, lacking = times_s([*shots.measured_utc, *readings])
    if seconds is None:
        raise ShotsInvalid(
            f"part_temperatures in campaign.yaml and the shots do not go together: {lacking}",
            remedy='give times as those of the shots, "2026-11-21T09:00:00Z"',
        )
    own, at, read = shots.part_temperature_degC, *np.split(seconds, [len(shots)])
    order = np.argsort(read, kind="stable")
    between = np.interp(at, read[order], np.array([*readings.values()])[order])
    return replace(shots, part_temperature_degC=np.where(np.isnan(own), between, own))
