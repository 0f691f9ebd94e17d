"""Options of the steps of a campaign, as the command line and Python give them."""

# Each field is one option of a command: its annotation has the help text, and app/options.py makes
# the command line of it. So Python and command line have the same options and the same defaults.
# Contradictions between options are refused when the options are made, before anything is read.

from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

from campaigns.controllers.export import CalibrationRoute
from campaigns.controllers.objections import ObjectionName
from campaigns.errors import OptionsInvalid
from campaigns.evaluation.validation import BY_DEFAULT, SET_OF
from campaigns.identification.options import Fixed, QuantityWord
from campaigns.planning.plans import Placement
from campaigns.settings.option import Option, typed_words
from campaigns.shots.shot_sets import ShotSet

ValidationStage = Literal["before", "after"]
ImportStage = Literal["before", "after", "check"]
ProgramStage = Literal["run", "before", "after", "check"]
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
"""Reconnections in a row after lost links and drive faults; None: as campaign.yaml says."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlanOptions:
    """Options of a plan; None: as campaign.yaml says.

    Raises `OptionsInvalid` for an odd number of shots, and for options that contradict each other.
    """

    shots: Annotated[
        int | None,
        Option(
            "Number of identification shots, two per pair; validation and drift shots are added. "
            "With --until: the maximum. 0: observations of --observe alone, without a tracker.",
            metavar="N",
            least=0,
        ),
    ] = None
    placement: Annotated[
        Placement | None,
        Option(
            "boundary: poses near the limits of the workspace, as in the paper. optimal: of "
            "thousands of candidates those that make positions least uncertain."
        ),
    ] = None
    until: Annotated[
        str | None,
        Option(
            "Optimal placement of the fewest shots that reach this mean σ of positions, in mm, "
            "such as 0.02.",
            metavar="MM",
        ),
    ] = None
    observe: Annotated[
        tuple[str, ...],
        Option(
            "Plan so many observations of an object of campaign.yaml, such as bed=30, and write "
            "observations.csv; repeatable. What is stated of the object says of which kind, or "
            "height:bed=30.",
            metavar="OBJECT=COUNT",
        ),
    ] = ()
    reflector: Annotated[
        tuple[str, ...],
        Option(
            "Measure every second pair with the reflector at this object of campaign.yaml, such as "
            "the other half of a plate; repeatable.",
            metavar="OBJECT",
        ),
    ] = ()
    quantity: Annotated[
        QuantityWord,
        Option(
            "What observations are chosen for, and compared by: position, rotation; flat or xy of "
            "a bed.",
            name="--for",
        ),
    ] = "position"
    fix: Fixed = ()
    seed: Annotated[int | None, Option("Another seed than campaign.yaml's.", "N", least=0)] = None
    force: Annotated[
        bool,
        Option("Plan anew although something is measured by the plan; the old one is kept beside."),
    ] = False

    def __post_init__(self) -> None:
        if self.shots is not None and self.shots % 2:
            raise OptionsInvalid(
                f"--shots is {self.shots}, but two make a pair", remedy="give an even number"
            )
        if self.shots == 0:
            self._check_without_shots()
        if self.placement is Placement.BOUNDARY and self.until is not None:
            raise OptionsInvalid(
                "--until is for shots that are chosen, but --placement boundary draws them",
                remedy="give --placement optimal, or leave --until out",
            )

    def _check_without_shots(self) -> None:
        """Raise `OptionsInvalid` for options of shots where there are none, or nothing to plan."""
        of_shots = {
            "--placement": self.placement is not None,
            "--until": self.until is not None,
            "--reflector": bool(self.reflector),
        }
        for name in [name for name, is_given in of_shots.items() if is_given]:
            raise OptionsInvalid(
                f"--shots 0 plans no shots, which {name} is for", remedy=f"leave {name} out"
            )
        if not self.observe:
            raise OptionsInvalid(
                "--shots 0 leaves nothing to plan", remedy="add --observe, such as bed=30"
            )


@dataclass(frozen=True, slots=True, kw_only=True)
class ProgramOptions:
    """Options of programs for a controller that is not connected; raises `OptionsInvalid`."""

    program: Annotated[
        Literal["csv"] | None,
        Option(
            "Write plan and tests as tables of poses and joints, and the joints of each shot. An "
            "existing plan.csv is written as it is, unless other options of plan are given."
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
class RunOptions:
    """Options of a run: when it ends, and what it leaves out."""

    until: Annotated[
        str | None,
        Option(
            "End early, once the mean σ of positions is this small, in mm, such as 0.02. "
            "Validation and drift shots are still taken.",
            metavar="MM",
        ),
    ] = None
    skip: Skip = ()
    retry: Retry = None
    force: Annotated[
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
    force: Annotated[
        bool, Option("Measure even if the stage is wrong, or 'before' is already measured.")
    ] = False
    by: Annotated[
        CalibrationRoute,
        Option(
            "With --stage after, what calibrates the robot: parameters in its controller, or "
            "corrected targets for a controller that keeps its nominal parameters."
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
        """Sets of shots of the requested tests; by default all but the ISO cube."""
        return frozenset(SET_OF[name] for name in self.only or BY_DEFAULT)


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckOptions:
    """Options of a check."""

    shots: Annotated[
        int | None, Option("Number of shots.", metavar="N", least=6, most=20, default="8")
    ] = None
    retry: Retry = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadOptions:
    """Options of a load, or of taking one back; raises `OptionsInvalid`."""

    file: Annotated[
        Path | None,
        Option(
            "Robot file to load, instead of DIR/robot-compensated.yaml.",
            metavar="FILE",
            name="--robot",
        ),
    ] = None
    rollback: Annotated[bool, Option("Restore the parameters that the latest load replaced.")] = (
        False
    )
    verify: Annotated[
        int,
        Option(
            "Measure N validation pairs before and after; roll back if they are worse beyond U.",
            metavar="N",
            least=0,
            default="none",
        ),
    ] = 0
    force: Annotated[
        tuple[ObjectionName, ...],
        Option(
            f"Overrule this objection; repeatable, the journal records it: "
            f"{', '.join(ObjectionName)}.",
            metavar="NAME",
        ),
    ] = ()

    def __post_init__(self) -> None:
        for option, is_given in (("--robot", self.file is not None), ("--verify", self.verify > 0)):
            if self.rollback and is_given:
                raise OptionsInvalid(
                    f"--rollback and {option} contradict each other", remedy="give one"
                )
