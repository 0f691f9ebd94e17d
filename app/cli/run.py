"""pkmcal run: measure the plan, or as much of it as the goal takes."""

from dataclasses import asdict

import typer

from app.console import Terminal, terminal_of
from app.exits import Exit
from app.measuring import RunJob, find_measured, measure
from app.next import tell_next, tell_who_works
from app.options import Anew, Dry, Folder, Json, Plain, Yes
from app.plan_text import plan_line
from app.run_screen import certainty
from app.run_text import preview_document, preview_line, run_document, show_run
from campaigns.campaign import Campaign, open_campaign
from campaigns.measuring.session import RunResult
from campaigns.measuring.work import Work
from campaigns.options import RunOptions
from campaigns.planning.plan_check import CheckedPlan
from campaigns.workflow.running import predicted_end, run_preview, run_work, state_by_journal


def command(
    context: typer.Context,
    folder: Folder,
    options: RunOptions,
    *,
    dry: Dry = False,
    yes: Yes = False,
    anew: Anew = False,
    plain: Plain = False,
    json: Json = False,
) -> None:
    """Measure the shots of the plan that are still missing.

    Every shot is written to the journal, campaign.db, before the next motion: whatever happens,
    the next run resumes where this one ended. It then first measures the drift pose and compares.

    On a terminal it has a screen, and keys: p pauses after this pair, s skips the shot, r measures
    the last pair again, k parks the robot, q stops. --plain prints lines instead.

    Ctrl-C stops the robot at once, and then asks. A broken beam suspends the run until the beam is
    back; then the pair is measured again. A pose that cannot be measured is deferred, tried once
    more at the end, and otherwise skipped. --dry shows what is left and what would stop the run.

    The screen shows how surely positions are known by the shots so far (1 σ on average, by the
    model that identify fits). --until ends the run when that is enough; a later run without it
    measures the rest.
    """
    terminal = terminal_of(context, as_json=json)
    campaign = open_campaign(folder)
    campaign.require_devices()
    with terminal.telling("reading the plan") as now_at:
        checked = campaign.checked_plan(tell=now_at)
    terminal.note(plan_line(checked))
    held = state_by_journal(campaign)
    if held is not None:
        terminal.note(f"since the last load the controller holds {held.says}")
    work = run_work(campaign, checked, options)
    ran = None if anew else find_measured(campaign, work, terminal)
    if dry:
        tell_who_works(terminal, campaign)
        show_preview(terminal, campaign, checked, work, ran, anew=anew)
        return
    if ran is None:
        predicted_end(campaign, work)
        preview = run_preview(campaign, checked.seconds, work, anew=anew)
        job = RunJob(campaign, work, preview, options.retry)
        ran = measure(job, terminal, yes=yes, anew=anew, plain=plain)
    show_run(terminal, ran)
    terminal.document(run_document(ran) | tell_next(terminal, campaign))
    if not ran.good:
        raise typer.Exit(Exit.NOT_GOOD)


def show_preview(
    terminal: Terminal,
    campaign: Campaign,
    checked: CheckedPlan,
    work: Work,
    ran: RunResult | None,
    *,
    anew: bool,
) -> None:
    """Say what a run would do, and the predicted uncertainty if there is a goal."""
    answer: dict[str, object] = {"shots": len(checked.shots), "seconds_estimated": checked.seconds}
    predicted = predicted_end(campaign, work) if ran is None else None
    if ran is None:
        preview = run_preview(campaign, checked.seconds, work, anew=anew)
        terminal.say(preview_line(preview, work))
        answer |= preview_document(preview)
    else:
        answer |= {"series": ran.series, "measured": ran.shots, "left": [], "skipped": []}
    terminal.say("the plan can be run; nothing was moved")
    if predicted is not None and work.goal_mm is not None:
        whole, shots = predicted
        terminal.say(f"predicted for the whole plan: {certainty(whole)}")
        terminal.say(f"goal {work.goal_mm:g} mm: {shots} shots to identify from will do")
        answer["goal"] = {"std_mm": work.goal_mm, "shots": shots}
        answer["knowledge"] = asdict(whole)
    terminal.document(answer | tell_next(terminal, campaign))
