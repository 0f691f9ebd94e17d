"""Options of the steps of a campaign, as the command line and Python give them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

from campaigns.controllers.export import CalibrationRoute
from campaigns.design.criteria import CriterionName
from campaigns.errors import OptionsInvalid
from campaigns.estimation.estimators import Estimator
from campaigns.evaluation.validation import BY_DEFAULT, SET_OF
from campaigns.identification.options import Fixed, Freed, ModelChoice, ModelToPlan, Selection
from campaigns.planning.plans import Placement
from campaigns.settings.option import Option, typed_words
from campaigns.shots.shot_sets import ShotSet

ValidationStage = Literal["before", "after"]
ProgramStage = Literal["run", "before", "after"]
ValidationTest = StrEnum("ValidationTest", {name: name for name in SET_OF})  # type: ignore[misc] # words of the tests
Skip = Annotated[
    tuple[int, ...],
    Option("Leave this shot out, and the other one of its pair; repeatable.", metavar="SHOT"),
]
Retry = Annotated[
    int | None,
    Option(
        "After a lost link or a drive's fault connect again and go on, up to N times in a "
        "row without a new shot. The cell must be safe without anybody there.",
        metavar="N",
        least=0,
        most=1000,
    ),
]
"""None: as campaign.yaml says."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanOptions(Selection):
    """Options of a plan; None: as campaign.yaml says. Raises `OptionsInvalid`."""

    shots: Annotated[
        int | None,
        Option(
            "Identification shots, two per pair, all others on top; with --until the maximum.",
            metavar="N",
            least=2,
        ),
    ] = None
    placement: Annotated[
        Placement | None,
        Option(
            "boundary: near the limits of the workspace, as in the paper. optimal: those of "
            "thousands of candidates that together carry most information."
        ),
    ] = None
    until: Annotated[
        str | None,
        Option(
            "Optimal, with as few shots as bring every length to this σ: σ=0.02 (mm).",
            metavar="GOAL",
        ),
    ] = None
    """In mm."""
    criterion: Annotated[
        CriterionName | None,
        Option(
            "What to optimise. I: positions all over the workspace, the default. D: all "
            "parameters together. A: each of them, on average. E: what is known worst."
        ),
    ] = None
    candidates: Annotated[
        int | None,
        Option(
            "Optimal: number of candidate poses; default 4000.", metavar="N", least=100, most=20_000
        ),
    ] = None
    estimator: Annotated[
        Estimator,
        Option(
            "How identify will use the shots. points: all their coordinates. distances: "
            "those of pairs, as in the paper."
        ),
    ] = Estimator.POINTS
    model: ModelToPlan = None
    free: Freed = ()
    fix: Fixed = ()
    scatter_mm: Annotated[
        float,
        Option(
            "The robot's own scatter (1 σ) where it is known, as `identify` stated it.",
            metavar="MM",
            name="--scatter",
        ),
    ] = 0.0
    """Known from earlier campaigns; not in the tracker's σ."""
    inaccurate: Annotated[
        bool,
        Option(
            "The robot may be 5 mm and 3° off: keep further off singularities, so that it can take "
            "all poses. Parameters are told less well."
        ),
    ] = False
    after_identify: Annotated[
        bool,
        Option(
            "For the robot as it was identified: poses that it can take, those that tell most of "
            "it, σ with its own scatter."
        ),
    ] = False
    seed: Annotated[int | None, Option("Another seed than campaign.yaml's.", "N", least=0)] = None

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
class ProgramOptions:
    """Options of programs for a controller that is not connected."""

    program: Annotated[
        Literal["csv"] | None,
        Option(
            "Write plan and tests as tables of poses and joints, and the joints of each shot; a "
            "plan.csv that is there is kept, unless options of a plan are given."
        ),
    ] = None
    stage: Annotated[
        ProgramStage | None, Option("With --program: this stage alone.", default="run and before")
    ] = None

    def __post_init__(self) -> None:
        if self.program is None and (words := typed_words(self)):
            raise OptionsInvalid(
                f"{words[0]} is for programs, but none is asked for",
                remedy=f"add --program csv, or leave {words[0]} out",
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class RunOptions(Selection):
    """Options of a run: when it ends, and what `identify` will be asked for."""

    until: Annotated[
        str | None,
        Option(
            "End early, once every length is known to this standard uncertainty: σ=0.02 (mm). "
            "Validation and drift shots are taken all the same.",
            metavar="GOAL",
        ),
    ] = None
    estimator: Annotated[Estimator, Option("The estimator that `identify` will use.")] = (
        Estimator.POINTS
    )
    model: ModelChoice = None
    free: Freed = ()
    fix: Fixed = ()
    skip: Skip = ()
    retry: Retry = None
    anyway: Annotated[
        bool,
        Option(
            "Continue although poses have moved since the last session; the journal records it."
        ),
    ] = False


@dataclass(frozen=True, slots=True, kw_only=True)
class ValidationOptions:
    """Options of a validation; raises `OptionsInvalid`."""

    stage: Annotated[ValidationStage, Option("Before or after `pkmcal load`.")]
    only: Annotated[
        tuple[ValidationTest, ...],
        Option(
            f"Only this test; repeatable: {', '.join(SET_OF)}. The last takes 150 shots and "
            "runs only if named.",
            metavar="TEST",
        ),
    ] = ()
    anyway: Annotated[
        bool, Option("Measure although it is the wrong stage, or 'before' is already measured.")
    ] = False
    by: Annotated[
        CalibrationRoute,
        Option(
            "What calibrates the robot, --stage after: parameters in its controller, or targets "
            "corrected for a controller that keeps the nominal ones."
        ),
    ] = "parameters"
    skip: Skip = ()
    retry: Retry = None

    def __post_init__(self) -> None:
        if self.by == "targets" and self.stage == "before":
            raise OptionsInvalid(
                "--stage before --by targets: before calibration no target is corrected",
                remedy="give --stage after, or leave --by targets out",
            )

    @property
    def tests(self) -> frozenset[ShotSet]:
        """Sets of the tests that are asked for; without a word those made by default."""
        return frozenset(SET_OF[name] for name in self.only or BY_DEFAULT)


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckOptions:
    """Options of a check."""

    shots: Annotated[
        int | None, Option("Shots to take.", metavar="N", least=6, most=20, default="10")
    ] = None
    retry: Retry = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadOptions:
    """Options of a load, or of taking one back; raises `OptionsInvalid`."""

    file: Annotated[
        Path | None,
        Option("Robot file to load, instead of DIR/robot-compensated.yaml.", metavar="FILE"),
    ] = None
    rollback: Annotated[bool, Option("Restore the parameters that the latest load replaced.")] = (
        False
    )
    verify: Annotated[
        int,
        Option(
            "Measure N validation pairs before and after; roll back if they become worse.",
            metavar="N",
            least=0,
            default="none",
        ),
    ] = 0
    force: Annotated[bool, Option("Load even if refused; the journal records the reasons.")] = False

    def __post_init__(self) -> None:
        for option, given in (("--file", self.file is not None), ("--verify", self.verify > 0)):
            if self.rollback and given:
                raise OptionsInvalid(
                    f"--rollback and {option} contradict each other", remedy="give one"
                )
