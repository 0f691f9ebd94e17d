"""Running of a plan on a connected cell, or as much of it as a goal takes."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from campaigns.campaign import Campaign
from campaigns.controllers.controller_state import ControllerState
from campaigns.controllers.load_journal import load_history
from campaigns.errors import OptionsInvalid
from campaigns.measuring import resume
from campaigns.measuring.run_state import SILENT, PositionUncertainty, RunObserver
from campaigns.measuring.session import RunResult, measure_series, run_result
from campaigns.measuring.stopping_rule import predicted_stop, read_goal
from campaigns.measuring.work import Cell, Work
from campaigns.options import RunOptions
from campaigns.planning.plan_check import CheckedPlan
from campaigns.planning.steps import groups, joint_steps, shots_of
from campaigns.workflow.identification import identification_options
from campaigns.workflow.work import engine_work, known_sets


def run_work(campaign: Campaign, checked: CheckedPlan, options: RunOptions | None = None) -> Work:
    """Plan as work for the engine, the shots commanded by joints.

    Raises `OptionsInvalid` or `PlanInvalid`.
    """
    options = options or RunOptions()
    goal_mm = None if options.until is None else read_goal(options.until)
    robot = campaign.robot
    how = identification_options(campaign)
    steps = joint_steps(checked.shots)
    work = engine_work(campaign, "run", steps, robot.kinematics, robot.digest(), how)
    skip = known_shots((shot.shot for shot in checked.shots), options.skip)
    return replace(work, goal_mm=goal_mm, skip=skip, override=options.force, compared_at_end=True)


def known_shots(
    shots: Iterable[int], skip: tuple[int, ...], of: str = "plan.csv"
) -> frozenset[int]:
    """Return the shots to skip; raise `OptionsInvalid` for one that is not among the shots."""
    unknown = sorted(set(skip) - {*shots})
    if unknown:
        raise OptionsInvalid(
            f"--skip {unknown[0]}: {of} has no such shot",
            remedy="give a number of the column shot, or one that the screen says",
        )
    return frozenset(skip)


@dataclass(frozen=True, slots=True)
class RunPreview:
    """What a run would do: what is there of its plan, and what it would measure."""

    series: int | None
    """The series that it would go on with; None: a new one."""
    shots: int
    """Of the plan."""
    measured: int
    """Of these, what counts already."""
    left: tuple[int, ...]
    """What it would measure; a pair that was cut in two as a whole."""
    skipped: tuple[int, ...]
    """What --skip leaves out."""
    seconds: float
    """Estimate for what is left."""


def state_by_journal(campaign: Campaign) -> ControllerState | None:
    """Return the state of the controller after the latest load in the journal; None without any.

    Joints are commanded in a run: nothing depends on it, and no one is asked.
    """
    if not campaign.journal_path.exists():
        return None
    with campaign.journal_reader() as journal:
        loads, _ = load_history(journal)
    return known_sets(campaign).state(loads[-1].digest) if loads else None


def run_preview(
    campaign: Campaign, seconds: float, work: Work, *, anew: bool = False
) -> RunPreview:
    """Return what `run` would do now, by work that takes so long, journal and campaign.yaml.

    Raises `ResumeRefused` as far as that can be known without one.
    """
    series, kept = None, resume.ResumeState((), (), groups(work.steps))
    if campaign.journal_path.exists() and not anew:
        with campaign.journal_reader() as journal:
            series = resume.series_to_take_up(journal, work)
            if series is not None:
                config = campaign.config
                resume.check_same_devices(series, config.controller.serial, config.tracker.serial)
                kept = resume.resume_state(work.steps, series.shots)
    not_wanted = work.skipped_groups
    skipped = [group for group in kept.left if group in not_wanted]
    unmeasured = [shot for group in kept.left if group not in skipped for shot in shots_of(group)]
    return RunPreview(
        None if series is None else series.number,
        len(work.steps),
        len(work.steps) - sum(map(len, kept.left)),
        tuple(unmeasured),
        tuple(shot for group in skipped for shot in shots_of(group)),
        seconds * len(unmeasured) / max(len(work.steps), 1),
    )


def predicted_end(campaign: Campaign, work: Work) -> tuple[PositionUncertainty, int] | None:
    """Return what the whole plan will show, and after how many shots a goal will be met.

    Raises `PlanInvalid` when even the whole plan will not meet it.
    """
    if work.goal_mm is None:
        return None
    return predicted_stop(work.goal_mm, work.uncertainty_monitor, campaign.config.tracker.place_mm)


def measured_before(campaign: Campaign, work: Work) -> RunResult | None:
    """Return series that has all that is wanted of this plan; None while it lacks something."""
    if not campaign.journal_path.exists():
        return None
    with campaign.journal_reader() as journal:
        done = resume.complete_series(journal, work)
        return None if done is None else run_result(journal, done.number, work)


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
