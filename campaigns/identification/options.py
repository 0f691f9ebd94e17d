"""Options of an identification: what is found of which shots, and how they are understood."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Annotated

from campaigns.arrays import Array
from campaigns.errors import OptionsInvalid
from campaigns.estimation.estimators import Estimator, Model, Outliers
from campaigns.estimation.tracker_noise import TrackerUncertainty
from campaigns.evaluation.diagnostics import COMMON_SCALE, LARGE_CHANGE
from campaigns.identification.parameter_selection import REFLECTOR_CONSTANT
from campaigns.robots.schema import Tolerance
from campaigns.settings.option import Option
from campaigns.settings.sections import KnownLengthConfig

MOST_HELD_OUT = 0.5
RANGE = re.compile(r"(\d*)-(\d*)", re.ASCII)

_MODEL = Option(
    "paper, standard: lengths, places and joint offsets. rods: also unequal rods, which tilt the "
    "plate. full: also tilted axes, which tilt it too. auto: the smallest of these that hold-out "
    "pairs and BIC do not reject, and significant errors of gears and encoders: backlash, "
    "eccentricity, ripple, ratio. extended: as auto, with axis directions and backlash.",
    default="the plan's",
)
ModelChoice = Annotated[Model | None, _MODEL]
"""None: the model that the plan was made for."""
ModelToPlan = Annotated[Model | None, replace(_MODEL, default="full")]
ModelToFind = Annotated[Model | None, replace(_MODEL, default="auto, or the plan's")]
Freed = Annotated[
    tuple[str, ...],
    Option(
        "Identify these too, such as 'arm*.azimuth_deg', or identify's reflector_constant_mm; "
        "repeatable.",
        metavar="PATTERN",
    ),
]
Fixed = Annotated[
    tuple[str, ...],
    Option("Keep these at their nominal values, 'arm1.*'; repeatable.", metavar="PATTERN"),
]


def range_of(text: str) -> tuple[int | None, int | None]:
    """First and last number of a range such as `0-60`, `-60` or `61-`; raises `OptionsInvalid`."""
    found = RANGE.fullmatch(text)
    if found is None:
        raise OptionsInvalid(f"--shots is '{text}'", remedy="give a range, 0-60, -60 or 61-")
    first, last = (int(part) if part else None for part in found.groups())
    return first, last


def share_of(text: str) -> float:
    """Share written as `20%` or `0.2`; raises `OptionsInvalid`."""
    try:
        value = float(text.removesuffix("%"))
    except ValueError as error:
        raise OptionsInvalid(f"--hold-out is '{text}'", remedy="give a share, 20%") from error
    return value / 100.0 if text.endswith("%") else value


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """Selection of parameters: patterns to free and to hold, and how they are estimated."""

    estimator: Estimator = Estimator.POINTS
    model: ModelChoice = None
    free: Freed = ()
    fix: Fixed = ()


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class IdentificationOptions(Selection):
    """Options of an identification; raises `OptionsInvalid`.

    What is no `Option` is not asked for: a campaign says it of itself.
    """

    estimator: Annotated[
        Estimator,
        Option(
            "points: all coordinates of every shot. distances: of pairs; with --model paper all "
            "alike, as in the paper."
        ),
    ] = Estimator.POINTS
    model: ModelToFind = None
    free: Freed = ()
    fix: Fixed = ()
    prior: Annotated[
        tuple[str, ...],
        Option(
            "Prior about nominal with this σ (mm, deg, ppm), 'arm*.arm_mm=0.05'; repeatable.",
            metavar="PATTERN=σ",
        ),
    ] = ()
    outliers: Annotated[
        Outliers,
        Option("What to do with outliers, shots that contradict all others; each is named."),
    ] = Outliers.EXCLUDE
    shots: Annotated[
        tuple[int | None, int | None],
        Option(
            "Use only these shots, by number: 0-60, -60 or 61-; after a change.",
            metavar="A-B",
            read=range_of,
        ),
    ] = (None, None)
    """First and last number of the shots to identify from; None: no limit."""
    sessions: Annotated[
        bool, Option("Fit one frame per session: the tracker was moved between sessions.")
    ] = False
    hold_out: Annotated[
        float,
        Option(
            "Keep this share of the pairs out of the fit, 20%: for data without a validation set.",
            metavar="SHARE",
            read=share_of,
            typed="0%",
        ),
    ] = 0.0
    """Share of the identification pairs that are kept unseen, as if they were for validation."""
    accept_large_change: Annotated[
        bool, Option("Accept a change beyond robot.yaml's tolerance.")
    ] = False
    accept_scale: Annotated[bool, Option("Accept that all lengths changed by the same share.")] = (
        False
    )

    instrument: TrackerUncertainty = field(default_factory=TrackerUncertainty)
    """Of shots of which the tracker stated nothing."""
    tolerance: Tolerance = field(default_factory=Tolerance)
    yielding: bool = False
    """Whether terms of eccentric encoders stand for gears that yield under the plate's weight."""
    limits_mm: Mapping[str, float] = field(default_factory=dict)
    """Acceptance limits of distances, `mean` and `max`, as far as any are asked for."""
    known_lengths: tuple[KnownLengthConfig, ...] = ()
    """Calibrated lengths that the set known-length measures."""
    workspace: Array | None = None
    """Poses (N, t) at which the position's uncertainty is asked for."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.hold_out <= MOST_HELD_OUT:
            raise OptionsInvalid(
                f"--hold-out is {self.hold_out:.4g}, must be 0 to {MOST_HELD_OUT:g}",
                remedy="20% is usual",
            )
        if self.frees_reflector_constant and self.estimator is not Estimator.POINTS:
            raise OptionsInvalid(
                f"--free {REFLECTOR_CONSTANT} belongs to --estimator points",
                remedy="distances alone cannot determine it: leave one of the two out",
            )

    @property
    def frees_reflector_constant(self) -> bool:
        """Whether ranges may be too long by one constant, which is no robot's parameter."""
        return REFLECTOR_CONSTANT in self.free

    @property
    def equal_weights(self) -> bool:
        """Whether distances count alike, as in the paper: its model by its estimator."""
        return self.estimator is Estimator.DISTANCES and self.model is Model.PAPER

    @property
    def accepted(self) -> frozenset[str]:
        """Names of the doubts with which a result is taken all the same."""
        asked = {LARGE_CHANGE: self.accept_large_change, COMMON_SCALE: self.accept_scale}
        return frozenset(name for name, wanted in asked.items() if wanted)


AS_THE_PAPER = IdentificationOptions(
    estimator=Estimator.DISTANCES, model=Model.PAPER, outliers=Outliers.KEEP
)
"""Plain least squares of the distances of all pairs."""
