"""pkmcal run: measure the plan, or as many of its shots as the goal needs."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from app.console import WARNING, Terminal
from app.measuring import ObservationJob, RunJob, find_measured, measure
from app.next import tell_next, tell_source_of_u, tell_who_works
from app.options import Anew, Dry, Plain, Yes
from app.plan_text import plan_line
from app.run_screen import certainty
from app.run_text import preview_line, show_run
from campaigns.campaign import Campaign
from campaigns.measuring.observing import ObservationResult
from campaigns.measuring.run_state import PositionUncertainty
from campaigns.measuring.session import RunResult
from campaigns.measuring.work import Work
from campaigns.options import RunOptions
from campaigns.planning.plan_check import CheckedPlan
from campaigns.shots.observations_csv import FILE_NAME, default_in_words
from campaigns.workflow.observation_run import doubt_of, planned_observations
from campaigns.workflow.running import predicted_end, run_preview, run_work, state_by_journal
from drivers.bounded_files import is_there


@dataclass(frozen=True, slots=True, kw_only=True)
class RunAnswer:
    """Answer of `run`: what was measured, and whether the goal is met; None without a goal."""

    series: int
    shots: int
    goal: Mapping[str, object] | None
    knowledge: PositionUncertainty | None
    settling: Mapping[str, object] | None
    skipped: Sequence[Mapping[str, object]]
    changed: str
    """How the robot has changed by its reference poses; "" if it has not."""
    observations: ObservationResult | None
    """What was measured after the shots by observations.csv; None where it plans nothing."""


def command(
    terminal: Terminal,
    campaign: Campaign,
    options: RunOptions,
    *,
    dry: Dry = False,
    yes: Yes = False,
    anew: Anew = False,
    plain: Plain = False,
) -> None:
    """Measure the shots of the plan that are still missing.

    Every shot is written to the journal, campaign.db, before the next motion: whatever happens,
    the next run resumes where this one ended. It then first measures the drift pose and compares.

    On a terminal it has a screen, and keys: p pauses after this pair, s skips the shot, r measures
    the last pair again, k parks the robot, q stops. --plain prints lines instead.

    Ctrl-C stops the robot at once, and then asks. A broken beam suspends the run until the beam is
    back; then the pair is measured again. A pose that cannot be measured is deferred, tried once
    more at the end, and otherwise skipped. --dry shows what is left and what would stop the run.

    The screen shows how uncertain positions are after the shots so far (mean 1 σ, with the model
    that identify fits). --until ends the run when this σ is small enough; a later run without
    --until measures the rest.

    Rows of observations.csv without a value come after the shots, or alone: the robot goes to their
    joints, and what the instrument shows is typed at the terminal. Each value is in the journal
    before the next motion, and in the file.

    Exit code 1: the goal is not met, or the robot itself has changed by its reference poses.

    pkmcal run cell-3
    pkmcal run cell-3 --until 0.02 --retry 5 --yes
    """
    campaign.require_devices()
    planned = planned_observations(campaign)
    if planned and not is_there(campaign.plan_path):
        if dry:
            terminal.say(f"{len(planned)} observations; nothing was moved")
            terminal.conclude({"observations": len(planned)}, tell_next(terminal, campaign))
            return
        alone = measure_observations(campaign, terminal, options, yes=yes, plain=plain)
        terminal.conclude(alone, tell_next(terminal, campaign))
        return
    with terminal.telling("reading the plan") as now_at:
        checked = campaign.checked_plan(tell=now_at)
    terminal.note(plan_line(checked))
    held = state_by_journal(campaign)
    if held is not None:
        terminal.note(f"since the last load the controller holds {held.says}")
    work = run_work(campaign, checked, options)
    # a complete series is answered again and not measured again, unless `--anew` asks for a new one
    ran = None if anew else find_measured(campaign, work, terminal)
    if dry:
        tell_who_works(terminal, campaign)
        show_preview(terminal, campaign, checked, work, ran, anew=anew)
        return
    if ran is None:
        tell_source_of_u(terminal, campaign)
        predicted_end(campaign, work)  # refuses a goal that the whole plan cannot reach
        preview = run_preview(campaign, checked.seconds, work, anew=anew)
        job = RunJob(campaign, work, preview, options.retry)
        ran = measure(job, terminal, yes=yes, anew=anew, plain=plain)
    show_run(terminal, ran)
    observed: ObservationResult | None = None
    if planned:
        observed = measure_observations(campaign, terminal, options, yes=True, plain=plain)
    terminal.conclude(run_answer(ran, observed), tell_next(terminal, campaign), is_good=ran.good)


def measure_observations(
    campaign: Campaign, terminal: Terminal, options: RunOptions, *, yes: bool, plain: bool
) -> ObservationResult:
    """Measure the planned observations, and say which have no value; `yes`: the cell is clear."""
    rows = [planned.row for planned in planned_observations(campaign)]
    if by_default := default_in_words(rows):
        terminal.note(f"! {by_default}", WARNING)
    job = ObservationJob(campaign, len(rows), options.retry)
    observed = measure(job, terminal, yes=yes, plain=plain)
    terminal.say(f"measured: {observed.measured} observations, also written to {FILE_NAME}")
    for skipped in observed.skipped:
        terminal.say(f"not measured: {skipped}", WARNING)
    if doubt := doubt_of(campaign):
        terminal.say(f"implausible: {doubt}", WARNING)
    return observed


def run_answer(ran: RunResult, observed: ObservationResult | None) -> RunAnswer:
    """Return a run's result for programs, with that of the observations after its shots."""
    goal = settling = None
    if ran.goal_mm is not None:
        reached_mm = ran.uncertainty and ran.uncertainty.position_std_mm
        goal = {"std_mm": ran.goal_mm, "met": ran.reaches_goal, "reached_mm": reached_mm}
        goal["left_out"] = ran.left_out
    if ran.settling is not None:
        settling = {"visits": ran.settling.shots, "says": ran.settling.text}
    return RunAnswer(
        series=ran.series,
        shots=ran.shots,
        goal=goal,
        knowledge=ran.uncertainty,
        settling=settling,
        skipped=[{"shots": shots, "reason": reason} for shots, reason in ran.skipped.items()],
        changed=ran.changed,
        observations=observed,
    )


def show_preview(
    terminal: Terminal,
    campaign: Campaign,
    checked: CheckedPlan,
    work: Work,
    ran: RunResult | None,
    *,
    anew: bool,
) -> None:
    """Show what a run would do, and the predicted uncertainty if there is a goal."""
    answer: dict[str, object] = {
        "shots": len(checked.shots),
        "seconds_estimated": checked.seconds,
        "series": ran and ran.series,
        "measured": ran.shots if ran else 0,
        "left": (),
        "skipped": (),
        "seconds_left_estimated": 0.0,
        "goal": None,
        "knowledge": None,
    }
    predicted = None
    if ran is None:  # something is left to measure
        predicted = predicted_end(campaign, work)
        preview = run_preview(campaign, checked.seconds, work, anew=anew)
        terminal.say(preview_line(preview, work))
        answer |= {
            "series": preview.series,
            "measured": preview.measured,
            "left": preview.pending,
            "skipped": preview.skipped,
            "seconds_left_estimated": preview.seconds,
        }
    terminal.say("the plan can be run; nothing was moved")
    if predicted is not None and work.goal_mm is not None:
        whole, shots = predicted
        terminal.say(f"predicted for the whole plan: {certainty(whole)}")
        terminal.say(f"goal {work.goal_mm:g} mm: {shots} shots to identify from will do")
        answer |= {"goal": {"std_mm": work.goal_mm, "shots": shots}, "knowledge": whole}
    terminal.conclude(answer, tell_next(terminal, campaign))
