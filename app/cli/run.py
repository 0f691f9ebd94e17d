"""pkmcal run: measure the plan, or as much of it as the goal takes."""

import shlex
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Annotated

import typer

from app.exits import Exit, UsageInvalid
from app.options import Anew, Dry, Fix, Folder, Free, Json, Yes, identifying_words
from campaigns.estimation.estimators import Estimator

if TYPE_CHECKING:
    from app.console import Terminal
    from app.folder import Campaign
    from app.run_result import RunResult
    from campaigns.journal.journal import Journal, JournalReader
    from campaigns.measuring.session import Work
    from campaigns.measuring.shot_taker import Cell
    from campaigns.measuring.stopping_rule import PredictedStop
    from campaigns.planning.plan_check import CheckedPlan

CLEAR = "The robot will move. Is the cell clear?"

Until = Annotated[
    str | None,
    typer.Option(
        metavar="GOAL",
        help="End early, once every length is known to this standard deviation: σ=0.02 (mm). "
        "Validation and drift shots are taken all the same.",
    ),
]
Identifying = Annotated[
    Estimator, typer.Option("--estimator", help="What will identify, and so says what is known.")
]


@dataclass(frozen=True, slots=True)
class RunOptions:
    """When to end, and what `identify` will be asked for."""

    until: str | None = None
    estimator: Estimator = Estimator.POINTS
    free: tuple[str, ...] = ()
    fix: tuple[str, ...] = ()

    def words(self) -> list[str]:
        """The options again, as they are typed."""
        until = [] if self.until is None else ["--until", self.until]
        return [*until, *self.for_identify()]

    def for_identify(self) -> list[str]:
        """Those that `identify` has too."""
        return identifying_words(self.estimator, self.free, self.fix)


def command(
    context: typer.Context,
    folder: Folder,
    *,
    until: Until = None,
    estimator: Identifying = Estimator.POINTS,
    free: Free = None,
    fix: Fix = None,
    dry: Dry = False,
    yes: Yes = False,
    anew: Anew = False,
    json: Json = False,
) -> None:
    """Measure what the plan still lacks.

    Every shot is in the journal, campaign.db, before the next motion: whatever happens, the next
    run takes up where this one ended. It then measures the drift pose first and compares it.

    Ctrl-C stops the robot at once, and then asks. A broken beam suspends the run, the tracker
    looks for its reflector, and the pair is measured again.

    Meanwhile the parameter known worst is shown, with its σ. --until ends the run when enough is
    known; without it the next run measures what was left out. Give it the --estimator, --free and
    --fix that you will give to identify.
    """
    from app.cli.plan import plan_line
    from app.console import terminal_of
    from app.folder import open_campaign
    from app.run_result import document, show

    terminal = terminal_of(context, as_json=json)
    campaign = open_campaign(folder)
    checked = read_checked_plan(campaign)
    terminal.note(plan_line(checked))
    asked = RunOptions(until, estimator, tuple(free or ()), tuple(fix or ()))
    work = work_of(campaign, checked, asked)
    if dry:
        show_plan(terminal, campaign, checked, work)
        return
    ran = None if anew else measured_before(campaign, work, terminal)
    ran = ran or measured_now(campaign, work, terminal, asked, yes=yes, anew=anew)
    show(terminal, ran)
    next_step = shlex.join(["pkmcal", "identify", str(folder), *asked.for_identify()])
    terminal.note(f"next: {next_step}")
    terminal.document(document(ran))
    if not ran.good:
        raise typer.Exit(Exit.NOT_GOOD)


def measured_now(
    campaign: "Campaign",
    work: "Work",
    terminal: "Terminal",
    asked: RunOptions,
    *,
    yes: bool,
    anew: bool,
) -> "RunResult":
    """Measure what is missing, once the goal is known to be in reach and the cell to be clear."""
    foreseen_end_of(campaign, work)
    terminal.require_yes(CLEAR, yes=yes)
    return measure_plan(campaign, work, terminal, asked, anew=anew)


def read_checked_plan(campaign: "Campaign") -> "CheckedPlan":
    """plan.csv, checked again: it may have been edited. Raises `PlanInvalid`."""
    from app.work_builders import checked_plan
    from campaigns.planning.plan_file import read_plan

    return checked_plan(campaign, read_plan(campaign.plan_path))


def work_of(campaign: "Campaign", checked: "CheckedPlan", asked: RunOptions) -> "Work":
    """The plan as work for the engine.

    Raises `GoalInvalid`, `SelectionInvalid`, `UsageInvalid` or `PlanInvalid`.
    """
    from app.work_builders import plan_work
    from campaigns.identification.parameter_selection import select_parameters
    from campaigns.measuring.stopping_rule import read_goal
    from campaigns.mechanisms.geometry import GEOMETRY_NAMES
    from campaigns.planning.predicted_precision import require_observable

    goal = None if asked.until is None else read_goal(asked.until)
    free = select_parameters(asked.free, asked.fix, names=GEOMETRY_NAMES).free
    if goal is not None and not any(name.endswith("_mm") for name in free):
        raise UsageInvalid(
            f"--until {goal} is a goal for lengths, but none of them is free",
            remedy="leave --until out, or hold fewer parameters with --fix",
        )
    work = replace(plan_work(campaign, checked), goal=goal, estimator=asked.estimator, free=free)
    if asked.free:
        knowing = work.knowing()
        require_observable(knowing.workspace_rows, knowing.free)
    return work


def foreseen_end_of(campaign: "Campaign", work: "Work") -> "PredictedStop | None":
    """How early the goal will be met, if there is one.

    Raises `PlanInvalid` when even the whole plan will not meet it.
    """
    from campaigns.measuring.stopping_rule import predicted_stop

    if work.goal is None:
        return None
    return predicted_stop(work.goal, work.knowing(), campaign.config.tracker.place_mm)


def run_plan(campaign: "Campaign", checked: "CheckedPlan", terminal: "Terminal") -> "RunResult":
    """Measure all of the plan that is missing."""
    asked = RunOptions()
    work = work_of(campaign, checked, asked)
    before = measured_before(campaign, work, terminal)
    return before or measure_plan(campaign, work, terminal, asked)


def measure_plan(
    campaign: "Campaign",
    work: "Work",
    terminal: "Terminal",
    asked: RunOptions,
    *,
    anew: bool = False,
) -> "RunResult":
    """Take up the unfinished series, or begin one."""
    from app.measuring import measure

    def prepare(cell: "Cell") -> "Work":  # noqa: ARG001 - the plan asks nothing of the devices
        return work

    def finish(journal: "Journal", series: int) -> "RunResult":
        return _ran(journal, series, work)

    again = shlex.join(["pkmcal", "run", str(campaign.folder), *asked.words()])
    return measure(campaign, prepare, finish, terminal, title="run", again=again, anew=anew)


def measured_before(campaign: "Campaign", work: "Work", terminal: "Terminal") -> "RunResult | None":
    """The series that has all that is wanted of this plan; None while it lacks something."""
    from campaigns.journal.journal import read_journal
    from campaigns.measuring.session import complete_series

    if not campaign.journal_path.exists():
        return None
    with read_journal(campaign.journal_path) as journal:
        done = complete_series(journal, work)
        if done is None:
            return None
        ran = _ran(journal, done.number, work)
    more = (
        "a run without --until takes the rest" if ran.left_out else "--anew takes all of it again"
    )
    terminal.note(f"nothing is left to measure; {more}")
    return ran


def _ran(journal: "JournalReader", series: int, work: "Work") -> "RunResult":
    from app.run_result import RunResult
    from campaigns.measuring.session import count_left_out, precision_from

    shots = journal.shots(series)
    return RunResult(
        series, len(shots), count_left_out(shots, work), work.goal, precision_from(shots, work)
    )


def show_plan(
    terminal: "Terminal", campaign: "Campaign", checked: "CheckedPlan", work: "Work"
) -> None:
    """Say that the plan can be run, and what it will tell if a goal asks for it."""
    from app.progress import certainty
    from app.run_result import knowledge

    answer: dict[str, object] = {
        "shots": len(checked.shots),
        "seconds_estimated": checked.seconds,
    }
    foreseen = foreseen_end_of(campaign, work)
    terminal.say("the plan can be run; nothing was moved")
    if foreseen is not None and work.goal is not None:
        terminal.say(f"the whole of it will tell: {certainty(foreseen.whole)}")
        terminal.say(f"for goal {work.goal}, {foreseen.shots} shots to identify from will do")
        answer["goal"] = {"std_mm": work.goal.std_mm, "shots": foreseen.shots}
        answer["knowledge"] = knowledge(foreseen.whole)
    terminal.document(answer)
