"""Validation series made by hand: accepted shots, each commanded somewhere and measured there."""

import numpy as np
from fake_cell import TRACKER_FROM_BASE

from campaigns.evaluation.validation import ValidationResult, evaluate_validation
from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.journal.records import Intent, Outcome
from campaigns.journal.views import AcceptedShot
from campaigns.kinematics.catalog import PAR4
from campaigns.shots.shot_sets import ShotSet
from campaigns.shots.shots import Shots, shots_of_journal
from drivers.values import Pose

JOINTS = (0.1, 0.2, 0.3, 0.4)
MIDDLE = (0.0, 0.0, -575.0)
INSTRUMENT = TrackerUncertainty()


def shot(
    number: int, purpose: ShotSet, commanded, measured=None, pair: int | None = None
) -> AcceptedShot:
    """A shot whose reflector was where it was commanded, or at `measured` in the base frame."""
    place = np.array(commanded if measured is None else measured, dtype=float)
    seen = TRACKER_FROM_BASE.apply(place[None])[0]
    target = Pose(*map(float, commanded), theta_rad=0.0)
    intent = Intent(number, 1, purpose.value, target, JOINTS, "pose", pair)
    outcome = Outcome(number, 1, JOINTS, tuple(seen.tolist()), None, None, "", "", None)
    return AcceptedShot(intent, outcome, "2026-03-02T08:00:00Z")


def line(axis: int, points: int = 5, first: int = 0, bump_mm=None) -> list[AcceptedShot]:
    """Shots along a straight line, the middle one measured off it by the bump."""
    places = np.array(MIDDLE) + np.outer(np.linspace(-200.0, 200.0, points), np.eye(3)[axis])
    measured = places.copy()
    if bump_mm is not None:
        measured[points // 2] += bump_mm
    return [
        shot(first + row, ShotSet.STRAIGHTNESS, *both)
        for row, both in enumerate(zip(places, measured, strict=True))
    ]


def pairs(errors_mm: list[float]) -> list[AcceptedShot]:
    """Pairs along x, 300 mm commanded and `errors_mm` longer or shorter in truth."""
    shots = []
    along = np.eye(3)[0]
    for number, error in enumerate(errors_mm):
        here = np.array([-150.0, 40.0 * number, -500.0 - 30.0 * number])
        there = here + 300.0 * along
        kind = ShotSet.VALIDATION
        shots.append(shot(2 * number, kind, here, pair=number))
        shots.append(shot(2 * number + 1, kind, there, there + error * along, pair=number))
    return shots


def shots_of(accepted: list[AcceptedShot]) -> Shots:
    return shots_of_journal(accepted, PAR4)


def validated(
    accepted: list[AcceptedShot], instrument: TrackerUncertainty = INSTRUMENT
) -> ValidationResult:
    return evaluate_validation(shots_of(accepted), instrument)
