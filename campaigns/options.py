"""Options of the chain's steps, as the command line and Python give them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from campaigns.design.criteria import CriterionName
from campaigns.errors import OptionsInvalid
from campaigns.estimation.estimators import Estimator, LossShape, Model, Outliers, Weights
from campaigns.evaluation.doubts import COMMON_SCALE, LARGE_CHANGE
from campaigns.planning.plans import Placement

MOST_HELD_OUT = 0.5
BENDS_AT = 3.0
"""Tuning constant of the robust losses, in σ: where they bend."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Selection:
    """Selection of parameters: patterns to free and to hold, and how they are estimated."""

    estimator: Estimator = Estimator.POINTS
    model: Model = Model.STANDARD
    free: tuple[str, ...] = ()
    fix: tuple[str, ...] = ()

    def words(self) -> list[str]:
        """Words as they are typed, for the next step's command."""
        by = [] if self.estimator is Estimator.POINTS else ["--estimator", self.estimator.value]
        model = [] if self.model is Model.STANDARD else ["--model", self.model.value]
        freed = [word for pattern in self.free for word in ("--free", pattern)]
        fixed = [word for pattern in self.fix for word in ("--fix", pattern)]
        return [*by, *model, *freed, *fixed]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanOptions(Selection):
    """Options of a plan; None: as campaign.yaml says. Raises `OptionsInvalid`."""

    shots: int | None = None
    placement: Placement | None = None
    until: str | None = None
    """Goal such as σ=0.02, in mm."""
    criterion: CriterionName | None = None
    candidates: int | None = None
    scatter_mm: float = 0.0
    """1 σ of the robot's own scatter, known from earlier campaigns; not in the tracker's σ."""
    seed: int | None = None

    def __post_init__(self) -> None:
        if not 0.0 <= self.scatter_mm < math.inf:
            raise OptionsInvalid(
                f"--scatter is {self.scatter_mm:g} mm", remedy="give 0 or more, such as 0.1"
            )
        if self.shots is not None and self.shots % 2:
            raise OptionsInvalid(
                f"--shots is {self.shots}, but two make a pair", remedy="give an even number"
            )
        option = next(self.choosing, None)
        if self.placement is Placement.BOUNDARY and option is not None:
            raise OptionsInvalid(
                f"{option} is for shots that are chosen, but --placement boundary draws them",
                remedy=f"give --placement optimal, or leave {option} out",
            )

    @property
    def choosing(self) -> Iterator[str]:
        """Options given that only choosing can heed."""
        options = {
            "--until": self.until,
            "--criterion": self.criterion,
            "--candidates": self.candidates,
        }
        return (option for option, value in options.items() if value is not None)


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions(Selection):
    """Options of a run: when it ends, and what `identify` will be asked for."""

    until: str | None = None
    """Goal such as σ=0.02, in mm."""
    skip: tuple[int, ...] = ()
    """Shots that shall not be measured."""
    retry: int | None = None
    """How often to connect again in a row; None: as campaign.yaml says."""
    anyway: bool = False
    """Whether to go on although poses have moved since the last session."""

    def run_words(self) -> list[str]:
        """The options again, as they are typed; not `--anyway`, which is said each time."""
        until = [] if self.until is None else ["--until", self.until]
        skip = [word for shot in self.skip for word in ("--skip", str(shot))]
        retry = [] if self.retry is None else ["--retry", str(self.retry)]
        return [*until, *skip, *retry, *self.words()]


@dataclass(frozen=True, slots=True, kw_only=True)
class IdentifyOptions(Selection):
    """Options of an identification."""

    prior: tuple[str, ...] = ()
    """Priors such as `arm*.forearm_mm=0.05`: 1 σ in mm or deg about the nominal value."""
    loss: LossShape = LossShape.LINEAR
    loss_scale: float = BENDS_AT
    outliers: Outliers = Outliers.EXCLUDE
    weights: Weights = Weights.STATED
    """Of distances."""
    shots: tuple[int | None, int | None] = (None, None)
    """First and last number of the shots to identify from; None: no limit."""
    sessions: bool = False
    """Whether each session of measuring has a frame of its own."""
    hold_out: float = 0.0
    """Share of the identification pairs that are kept unseen, as if they were for validation."""
    accept_large_change: bool = False
    accept_scale: bool = False

    def __post_init__(self) -> None:
        if not 0.0 <= self.hold_out <= MOST_HELD_OUT:
            raise OptionsInvalid(
                f"--hold-out is {self.hold_out:.4g}, must be 0 to {MOST_HELD_OUT:g}",
                remedy="20% is usual",
            )

    @property
    def accepted(self) -> frozenset[str]:
        """Names of the doubts with which a result is taken all the same."""
        asked = {LARGE_CHANGE: self.accept_large_change, COMMON_SCALE: self.accept_scale}
        return frozenset(name for name, wanted in asked.items() if wanted)


AS_THE_PAPER = IdentifyOptions(
    estimator=Estimator.DISTANCES, outliers=Outliers.KEEP, weights=Weights.EQUAL
)
"""Plain least squares of the distances of all pairs."""
