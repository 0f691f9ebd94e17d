"""Uncertainty budget of positions by the identified parameters, contribution by contribution."""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from campaigns.evaluation.decision import COVERAGE

STEEL_PER_DEGC = 12e-6
"""Expansion of a steel robot, by which a change of the air is judged where no part was measured."""
RECTANGULAR = math.sqrt(12.0)
"""Width of a rectangular distribution over its standard deviation."""
COMMON_WORDS = {
    "scale": "tracker: scale, by its data sheet",
    "transit axis": "tracker: transit axis out of square",
    "collimation": "tracker: collimation",
    "vertical index": "tracker: vertical index",
    "reflector": "reflector: centre and constant",
}


@dataclass(frozen=True, slots=True)
class Contribution:
    """Standard uncertainty of a position from one source; the last rows combine those above."""

    source: str
    u_mm: float | None
    evaluated: str
    """Type A, from these shots, or B, from elsewhere (GUM); empty of a combined one."""
    counts: bool = True
    """Whether it is part of the combined uncertainty."""


def uncertainty_budget(
    *,
    random_mm: float,
    common_mm: Mapping[str, float],
    total_mm: float,
    tracker_share: float,
    air_change_degC: float | None,
    reach_mm: float,
) -> Iterator[Contribution]:
    """Contributions to the standard uncertainty of a position, mean over the workspace.

    `random_mm` is what noise of the shots leaves, of which `tracker_share` is the part of variance
    that the tracker states, the rest being the robot's scatter; `common_mm` what all shots share,
    by source; `total_mm` the combined one, a mean of roots: squares add up to it only nearly.
    """
    yield Contribution(
        "tracker: noise of points, as stated", random_mm * math.sqrt(tracker_share), "A"
    )
    robot = random_mm * math.sqrt(max(0.0, 1.0 - tracker_share))
    yield Contribution("robot: scatter of repeated poses and of its joints", robot, "A")
    for name, u_mm in common_mm.items():
        yield Contribution(COMMON_WORDS.get(name, name), u_mm, "B")
    yield Contribution(
        "frame: positions are compared in the frame fitted to the same shots",
        None,
        "",
        counts=False,
    )
    if air_change_degC is not None:
        warmth = STEEL_PER_DEGC * air_change_degC * reach_mm / RECTANGULAR
        source = f"temperature: air changed by {air_change_degC:.2f} °C, steel not following it"
        yield Contribution(source, warmth, "B", counts=False)
    yield Contribution("combined standard uncertainty u", total_mm, "")
    expanded = f"expanded uncertainty U = {COVERAGE:g} u (about 95 %)"
    yield Contribution(expanded, COVERAGE * total_mm, "")
