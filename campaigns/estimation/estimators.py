"""How parameters are estimated from shots; the values are the words on the command line."""

from enum import StrEnum


class Estimator(StrEnum):
    """Estimator: what the fit compares with the model."""

    POINTS = "points"
    """All coordinates of every shot, the tracker's frame being six more unknowns."""
    DISTANCES = "distances"
    """Distances of pairs, which need no common frame: the paper's (eq. 19)."""


class Model(StrEnum):
    """Model: how much of a robot may be found."""

    PAPER = "paper"
    """Lengths, places and joint offsets: the paper's model."""
    STANDARD = "standard"
    """The same unless told otherwise."""
    RODS = "rods"
    """Unequal rods too, which tilt the plate; all axes horizontal."""
    FULL = "full"
    """Unequal rods and tilted axes too, which tilt the plate."""
    AUTO = "auto"
    """The smallest that neither hold-out pairs nor BIC reject, of these; and what gears add."""
    EXTENDED = "extended"
    """Where the motors' axes point and what their gears lose too, if hold-out pairs support it."""


MAY_HAVE_GEARS = frozenset({Model.FULL, Model.AUTO})
"""Models beside which an identification may look for what gears and encoders do."""


class Outliers(StrEnum):
    """Treatment of shots that all the others contradict."""

    EXCLUDE = "exclude"
    """They are left out, each by name."""
    KEEP = "keep"
    """They count like all others."""
