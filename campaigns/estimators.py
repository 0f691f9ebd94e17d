"""How parameters are estimated from shots; the values are the words on the command line."""

from enum import StrEnum


class Estimator(StrEnum):
    """What the fit compares with the model."""

    POINTS = "points"
    """All coordinates of every shot, the tracker's frame being six more unknowns."""
    DISTANCES = "distances"
    """Distances of pairs, which need no common frame: the paper's (eq. 19)."""
