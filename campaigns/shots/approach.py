"""From which side each joint came to rest at a shot: what tells on which flank its gear lies."""

from collections.abc import Sequence

import numpy as np

from campaigns.journal.views import AcceptedShot
from campaigns.numerics.geometry import Array
from campaigns.parameters import ARMS

TAKEN_UP_RAD = float(np.radians(5.0 / 60.0))
"""A joint that went this far has taken up its gear's lost motion, whatever it did before."""
AT_REST_RAD = float(np.radians(0.005))
"""Readings of a joint that stands still differ by less."""


def approach(shots: Sequence[AcceptedShot]) -> Array:
    """+1 where a joint last moved towards larger angles, -1 smaller, 0 where unknown, (N, 4).

    A joint that hardly moved on the last leg keeps the direction of the shot before, if it stood
    there when the leg began and was not turned round. Before means before in time: a shot measured
    again comes after others of higher numbers.
    """
    found = np.zeros((len(shots), ARMS))
    before, standing_rad = np.zeros(ARMS), np.full(ARMS, np.nan)
    for row in sorted(range(len(shots)), key=lambda row: shots[row].measured_utc):
        outcome = shots[row].outcome
        joints_rad = np.array(outcome.joints_rad)
        if outcome.came_from_rad is not None:
            came_from_rad = np.array(outcome.came_from_rad)
            straight = bool((np.abs(came_from_rad - standing_rad) < AT_REST_RAD).all())
            found[row] = _direction(joints_rad - came_from_rad, before * straight)
        before, standing_rad = found[row], joints_rad
    return found


def _direction(moved_rad: Array, before: Array) -> Array:
    """Of each joint after a leg, (4,), from how far it went and the direction before the leg."""
    way = np.sign(moved_rad)
    kept = (np.abs(moved_rad) < AT_REST_RAD) | (way == before)
    return np.where(np.abs(moved_rad) > TAKEN_UP_RAD, way, np.where(kept, before, 0.0))
