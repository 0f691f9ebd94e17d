"""Running of a plan on a connected cell, or as much of it as a goal takes."""

from collections.abc import Callable
from dataclasses import dataclass, replace

from campaigns.campaign import Campaign
from campaigns.chain.work import engine_work, free_parameters
from campaigns.errors import OptionsInvalid
from campaigns.estimation.estimators import Model
from campaigns.measuring.resume import resume_state
from campaigns.measuring.run_state import SILENT, RunObserver
from campaigns.measuring.session import (
    RunResult,
    Work,
    complete_series,
    measure_series,
    run_result,
    series_to_take_up,
)
from campaigns.measuring.shot_taker import Cell
from campaigns.measuring.stopping_rule import PredictedStop, predicted_stop, read_goal
from campaigns.options import RunOptions
from campaigns.planning.plan_check import CheckedPlan
from campaigns.planning.predicted_precision import (
    EstimationSetup,
    require_identifiable,
)
from campaigns.planning.steps import joint_steps


def run_work(campaign: Campaign, checked: CheckedPlan, options: RunOptions | None = None) -> Work:
    """Plan as work for the engine, the shots commanded by joints.

    Raises `GoalInvalid`, `SelectionInvalid`, `OptionsInvalid` or `PlanInvalid`.
    """
    options = options or RunOptions()
    goal = None if options.until is None else read_goal(options.until)
    free = free_parameters(campaign, options)
    if goal is not None and not any(name.endswith("_mm") for name in free):
        raise OptionsInvalid(
            f"--until {goal} is a goal for lengths, but none of them is free",
            remedy="leave --until out, or hold fewer parameters with --fix",
        )
    robot = campaign.robot
    setup = EstimationSetup(options.estimator, free, campaign.instrument)
    steps = joint_steps(checked.shots)
    work = engine_work(campaign, "run", steps, robot.kinematics, robot.digest(), setup)
    work = replace(work, goal=goal, compared_at_end=True)
    if options.free or options.model not in {Model.PAPER, Model.STANDARD}:
        require_identifiable(work.knowing().workspace, free)
    return work


def predicted_end(campaign: Campaign, work: Work) -> PredictedStop | None:
    """How early a run's goal will be met, if there is one.

    Raises `PlanInvalid` when even the whole plan will not meet it.
    """
    if work.goal is None:
        return None
    return predicted_stop(work.goal, work.knowing(), campaign.config.tracker.place_mm)


def measured_before(campaign: Campaign, work: Work) -> RunResult | None:
    """Series that has all that is wanted of this plan; None while it lacks something."""
    if not campaign.journal_path.exists():
        return None
    with campaign.journal_reader() as journal:
        done = complete_series(journal, work)
        return None if done is None else run_result(journal, done.number, work)


@dataclass(frozen=True, slots=True)
class ToMeasure:
    """Numbers of shots of a plan: those that a run will take, and those that are there.

    `series` is what it goes on with; None where it begins one.
    """

    left: int
    there: int = 0
    series: int | None = None


def to_measure(campaign: Campaign, work: Work, *, anew: bool = False) -> ToMeasure:
    """What a run that begins now will take, unless a goal ends it before."""
    if anew or not campaign.journal_path.exists():
        return ToMeasure(len(work.steps))
    with campaign.journal_reader() as journal:
        series = series_to_take_up(journal, work)
        if series is None:
            return ToMeasure(len(work.steps))
        found = resume_state(work.steps, journal.shots(series.number))
        return ToMeasure(sum(map(len, found.left)), len(found.kept), series.number)


def run(
    campaign: Campaign,
    cell: Cell,
    options: RunOptions | None = None,
    *,
    observer: RunObserver = SILENT,
    stop_requested: Callable[[], bool] = lambda: False,
    anew: bool = False,
) -> RunResult:
    """Measure on a connected cell what plan.csv still lacks.

    Raises `PlanInvalid`, `Interrupted`, or whatever stopped the engine; what was measured is kept.
    """
    work = run_work(campaign, campaign.checked_plan(), options)
    predicted_end(campaign, work)
    with campaign.journal() as journal:
        series = measure_series(cell, journal, work, observer, stop_requested, anew=anew)
        return run_result(journal, series, work)
