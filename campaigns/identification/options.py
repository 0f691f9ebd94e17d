"""Options of an identification: the model, its shots, held parameters, and prior tolerances.

Fields with an `Option` are typed by users; the command line, the Python API and the recorded
options of a result are all made from them. The other fields are facts of a campaign (instrument,
tolerances, limits), which `campaigns/workflow` fills in from its files.
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from typing import Annotated, Literal, get_args

from campaigns.arrays import Array
from campaigns.errors import OptionsInvalid
from campaigns.files.wording import shown, suggestion
from campaigns.fit.error_sources import SOURCES, TRACKER_SOURCES
from campaigns.fit.tracker_noise import TrackerUncertainty
from campaigns.kinematics.parameters import INNER, ParameterTable
from campaigns.robots.schema import Tolerance
from campaigns.settings.option import Option
from campaigns.settings.sections import KnownLengthConfig

QuantityWord = Literal["position", "rotation", "flat", "xy"]
"""What shots may determine."""
MOST_HELD_OUT = 0.5
LEAST_STD = 1e-6
"""Smallest 1 σ of a prior, mm, deg or ppm: a parameter known better is held with --fix."""
RANGE = re.compile(r"(\d*)-(\d*)", re.ASCII)
ModelWord = Literal["full", "paper"]
Model = Annotated[
    ModelWord,
    Option(
        "full: every source of error is fitted, with its tolerance as a prior. paper: lengths, "
        "places and joint offsets, by the distances of pairs alone."
    ),
]
Freed = Annotated[
    tuple[str, ...],
    Option(
        "With --model paper, fit these too: a parameter, a pattern ('arm*.azimuth_deg') or a "
        "group; repeatable.",
        metavar="NAME",
    ),
]
Fixed = Annotated[
    tuple[str, ...],
    Option(
        "Keep these at their nominal values: a parameter, a pattern ('arm1.*') or a group "
        "(eccentricity); repeatable.",
        metavar="NAME",
    ),
]
Priors = Annotated[
    tuple[str, ...],
    Option(
        "Tolerance (1 σ, in mm, deg or ppm) instead of that in robot.yaml, such as "
        "'arm*.arm_mm=0.05'; repeatable.",
        metavar="NAME=σ",
    ),
]


def range_of(text: str) -> tuple[int | None, int | None]:
    """Read a range of numbers such as `0-60`, `-60` or `61-`; raise `OptionsInvalid`."""
    ends = RANGE.fullmatch(text)
    if ends is None:
        raise OptionsInvalid(f"--only-shots is '{text}'", remedy="give a range, 0-60, -60 or 61-")
    first, last = (int(part) if part else None for part in ends.groups())
    return first, last


def share_of(text: str) -> float:
    """Read a share such as `20%` or `0.2`; raise `OptionsInvalid`."""
    try:
        value = float(text.removesuffix("%"))
    except ValueError as error:
        raise OptionsInvalid(f"--hold-out is '{text}'", remedy="give a share, 20%") from error
    return value / 100.0 if text.endswith("%") else value


@dataclass(frozen=True, slots=True, eq=False, kw_only=True)
class IdentificationOptions:
    """Options of an identification; raise `OptionsInvalid`. A campaign adds what is no `Option`."""

    model: Model = "full"
    free: Freed = ()
    fix: Fixed = ()
    prior: Priors = ()
    shots: Annotated[
        tuple[int | None, int | None],
        Option(
            "Use only shots with these numbers, 0-60, -60 or 61-, if the robot changed in between.",
            metavar="A-B",
            name="--only-shots",
            read=range_of,
        ),
    ] = (None, None)
    sessions: Annotated[
        bool, Option("Fit one frame per session: the tracker was moved between sessions.")
    ] = False
    hold_out: Annotated[
        float,
        Option(
            "Keep this share of the pairs, and of observations of each object, out of the fit, "
            "such as 20%, for data without a validation set.",
            metavar="SHARE",
            read=share_of,
            typed="0%",
        ),
    ] = 0.0
    quantities: Annotated[
        tuple[str, ...],
        Option(
            "Judge what shots and observations say of this: position, rotation, flat (height above "
            "a touched plane) or xy (in that plane); with commas, or repeatable. Otherwise it is "
            "what acceptance limits ask for, and position.",
            metavar="QUANTITY",
            name="--for",
        ),
    ] = ()
    accept_large_change: Annotated[
        bool, Option("Accept parameters far outside of their tolerance.", name="--force")
    ] = False

    instrument: TrackerUncertainty = field(default_factory=TrackerUncertainty)
    """Data sheet for shots of which the tracker stated nothing, and its common errors."""
    tolerances: Mapping[str, float] = field(default_factory=dict)
    """Tolerances from robot.yaml by group and unit (`rods_deg`), in mm, rad or ratios."""
    tolerance: Tolerance = field(default_factory=Tolerance)
    """Largest changes of the robot's parameters, by which shots are doubted."""
    limits_mm: Mapping[str, float] = field(default_factory=dict)
    """Acceptance limits of distances, `mean` and `max`, as far as there are any."""
    rotation_deg: float | None = None
    """Acceptance limit of the tool's rotation; None if there is none."""
    known_lengths: tuple[KnownLengthConfig, ...] = ()
    """Calibrated lengths that the set known-length measures."""
    reference_degC: float = 20.0
    """Temperature of the parts for which parameters are stated."""
    workspace: Array | None = None
    """Poses (N, t) at which the uncertainty of positions is stated."""

    def __post_init__(self) -> None:
        if self.model not in ("full", "paper"):
            raise OptionsInvalid(f"model is '{self.model}'", remedy="take full or paper")
        if not 0.0 <= self.hold_out <= MOST_HELD_OUT:
            raise OptionsInvalid(
                f"--hold-out is {self.hold_out:.4g}, must be 0 to {MOST_HELD_OUT:g}",
                remedy="20% is usual",
            )
        names = [name.strip() for text in self.quantities for name in text.split(",")]
        for name in names:
            if name not in get_args(QuantityWord):
                raise OptionsInvalid(
                    f"--for {shown(name)} is no quantity",
                    remedy=suggestion(name, get_args(QuantityWord)),
                )
        object.__setattr__(self, "quantities", tuple(dict.fromkeys(names)))

    @property
    def judged_quantities(self) -> tuple[str, ...]:
        """Quantities that the verdict is on: those asked for, or position and limited ones."""
        limited = () if self.rotation_deg is None else ("rotation",)
        return self.quantities or ("position", *limited)


def matching(pattern: str, table: ParameterTable) -> tuple[str, ...]:
    """Return the parameters that a name, pattern or group means; raise `OptionsInvalid`."""
    # Names of the tracker's errors come first: `scale` is both a group and the one name in it, and
    # a group is looked up among the robot's parameters only.
    names = (*table.select(), *TRACKER_SOURCES)
    if pattern in TRACKER_SOURCES:
        return (pattern,)
    if pattern in SOURCES:
        return table.select(group=pattern)
    matches = tuple(name for name in names if pattern and fnmatchcase(name, pattern))
    if matches:
        return matches
    raise OptionsInvalid(
        f"{shown(pattern) or 'an empty name'} is no parameter, pattern or group of parameters",
        remedy=suggestion(pattern, (*names, *SOURCES)),
    )


def named_priors(texts: Sequence[str], table: ParameterTable) -> dict[str, float]:
    """Read priors such as `arm*.arm_mm=0.05`: 1 σ by name in mm, rad or ratios."""
    priors: dict[str, float] = {}
    for text in texts:
        pattern, equals, number = text.partition("=")
        try:
            std = float(number)
        except ValueError:
            std = 0.0  # refused below, with the same words as a σ that is too small
        if not (equals and LEAST_STD <= std < float("inf")):
            raise OptionsInvalid(
                f"--prior {shown(text)}: σ must be a number from {LEAST_STD:g}",
                remedy="give name and σ in the name's unit, as arm*.forearm_mm=0.05; hold what "
                "is known for sure, with --fix",
            )
        for name in matching(pattern.strip(), table):
            unit = TRACKER_SOURCES[name] if name in TRACKER_SOURCES else table[name].unit
            # Typed in mm, deg or ppm; inside in mm, rad or ratios. A later text wins over an
            # earlier one, so a pattern may come first and its exceptions after it.
            priors[name] = std * INNER[unit]
    return priors
