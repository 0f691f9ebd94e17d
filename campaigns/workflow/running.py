"""Running of a plan on a connected cell, or as much of it as a goal takes."""

# plan.csv is checked whole before anything moves (planning/plan_check.py), and its shots become
# steps for the engine (measuring/engine.py), which measures, waits, repeats and resumes. Shots of
# a run are commanded by joints: the measured pairs of joints and point then do not depend on
# which parameters the controller holds, and identification needs nothing else.
#
# A run goes on where the last one ended: the latest series of the stage is taken up if it was begun
# with this plan and these devices. `run_preview` answers from the journal alone what would be
# measured, for --dry and for the question at a terminal; `run` decides it again when connected.
#
# With a goal (`--until`) positions need only be known to a mean σ. `predicted_end` computes
# beforehand, by the plan alone, after how many shots that will be, and refuses a goal that the
# whole plan does not reach. Validation and drift shots are taken in any case.

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from campaigns.campaign import Campaign
from campaigns.controllers.controller_state import ControllerState
from campaigns.controllers.load_journal import load_history
from campaigns.errors import OptionsInvalid
from campaigns.measuring import resume
from campaigns.measuring.run_state import SILENT, PositionUncertainty, RunObserver, Wishes
from campaigns.measuring.session import RunResult, measure_series, run_result
from campaigns.measuring.stopping_rule import predicted_stop, read_goal
from campaigns.measuring.work import Devices, Work
from campaigns.options import RunOptions
from campaigns.planning.plan_check import CheckedPlan
from campaigns.planning.steps import groups, joint_steps, shots_of
from campaigns.workflow.identification import identification_options
from campaigns.workflow.work import engine_work, known_sets


def run_work(campaign: Campaign, checked: CheckedPlan, options: RunOptions | None = None) -> Work:
    """Return a checked plan as work for the engine, its shots commanded by joints.

    Raise `OptionsInvalid` for a wrong goal or an unknown shot to skip, and `ConfigInvalid` for a
    parking place that the robot cannot take.
    """
    options = options or RunOptions()
    goal_mm = None if options.until is None else read_goal(options.until)
    robot = campaign.robot
    fit_options = identification_options(campaign)
    steps = joint_steps(checked.shots)
    work = engine_work(campaign, "run", steps, robot.kinematics, robot.digest(), fit_options)
    skip = known_shots((shot.shot for shot in checked.shots), options.skip)
    return replace(work, goal_mm=goal_mm, skip=skip, override=options.force, compared_at_end=True)


def known_shots(
    shots: Iterable[int], skip: tuple[int, ...], of: str = "plan.csv"
) -> frozenset[int]:
    """Return the shots to skip; raise `OptionsInvalid` for a number that is not among `shots`.

    `of` names the list of shots in the message.
    """
    unknown = sorted(set(skip) - {*shots})
    if unknown:
        raise OptionsInvalid(
            f"--skip {unknown[0]}: {of} has no such shot",
            remedy="give a number of the column shot, or one that the screen says",
        )
    return frozenset(skip)


@dataclass(frozen=True, slots=True)
class RunPreview:
    """Preview of a run: the shots that it has already, and those that it would measure."""

    series: int | None
    """Series that the run would go on with; None: a new one."""
    shots: int
    """Number of shots of the plan."""
    measured: int
    """Number of shots of the plan that are measured."""
    pending: tuple[int, ...]
    """Shots that the run would measure; both shots of a pair that was cut in two."""
    skipped: tuple[int, ...]
    """Shots that --skip leaves out."""
    seconds: float
    """Estimated time of the pending shots."""


def state_by_journal(campaign: Campaign) -> ControllerState | None:
    """Return the state of the controller after the latest load in the journal; None without a load.

    The controller is not asked: a run commands joints, and does not depend on its parameters.
    """
    if not campaign.journal_path.exists():
        return None
    with campaign.journal_reader() as journal:
        loads, _ = load_history(journal)
    return known_sets(campaign).state(loads[-1].digest) if loads else None


def run_preview(
    campaign: Campaign, seconds: float, work: Work, *, anew: bool = False
) -> RunPreview:
    """Return what `run` would do now, by the journal and campaign.yaml, without a connection.

    `seconds` is the time of the whole work. Raise `ResumeRefused` for another plan, or for serial
    numbers in campaign.yaml that are not those of the series.
    """
    series, kept = None, resume.ResumeState((), (), groups(work.steps))
    if campaign.journal_path.exists() and not anew:
        with campaign.journal_reader() as journal:
            series = resume.series_to_take_up(journal, work)
            if series is not None:
                config = campaign.config
                resume.check_same_devices(series, config.controller.serial, config.tracker.serial)
                kept = resume.resume_state(work.steps, series.shots)
    skipped = [group for group in kept.unmeasured if group in work.skipped_groups]
    pending = [
        shot for group in kept.unmeasured if group not in skipped for shot in shots_of(group)
    ]
    return RunPreview(
        series=None if series is None else series.number,
        shots=len(work.steps),
        measured=len(work.steps) - sum(map(len, kept.unmeasured)),
        pending=tuple(pending),
        skipped=tuple(shot for group in skipped for shot in shots_of(group)),
        seconds=seconds * len(pending) / max(len(work.steps), 1),
    )


def predicted_end(campaign: Campaign, work: Work) -> tuple[PositionUncertainty, int] | None:
    """Return the σ of positions after the whole plan, and after how many shots a goal is met.

    None without a goal. Raise `PlanInvalid` if the whole plan does not meet the goal.
    """
    if work.goal_mm is None:
        return None
    return predicted_stop(work.goal_mm, work.uncertainty_monitor, campaign.config.tracker.place_mm)


def measured_before(campaign: Campaign, work: Work) -> RunResult | None:
    """Return the result of a finished series that needs no more shots; None if there is none."""
    if not campaign.journal_path.exists():
        return None
    with campaign.journal_reader() as journal:
        complete = resume.complete_series(journal, work)
        return None if complete is None else run_result(journal, complete.number, work)


def run(
    campaign: Campaign,
    cell: Devices,
    options: RunOptions | None = None,
    *,
    observer: RunObserver = SILENT,
    stop_requested: Callable[[], bool] = lambda: False,
    anew: bool = False,
) -> RunResult:
    """Measure on a connected cell the shots of plan.csv that are not measured yet.

    Args:
        campaign: The campaign, with a plan.
        cell: Controller, tracker and time, from `connected_cell`, prepared by `prepare`.
        options: Options of `pkmcal run`: a goal, shots to skip.
        observer: Receives progress; by default nothing is reported.
        stop_requested: Returns True when the run shall end; the robot is then stopped.
        `anew`: Whether a new series is begun although one is unfinished.

    Returns:
        The series' number, its shots, those left out and skipped, and the σ of positions.

    Raises:
        PlanInvalid: The plan cannot be run as written, or does not meet the goal.
        ResumeRefused: The series was begun with another plan or other devices.
        Interrupted: `stop_requested` returned True; the measured shots are kept.
        GateRefused, DriverError: What stopped the engine; the measured shots are kept.

    Example:
        >>> with connected_cell(campaign) as cell:
        ...     prepare(campaign, cell)
        ...     result = workflow.run(campaign, cell)
    """
    work = run_work(campaign, campaign.checked_plan(), options)
    predicted_end(campaign, work)
    with campaign.journal() as journal:
        series = measure_series(cell, journal, work, observer, Wishes(stop_requested), anew=anew)
        return run_result(journal, series, work)
