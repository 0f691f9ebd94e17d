"""pkmcal plan: where to measure."""

from dataclasses import asdict
from pathlib import Path

import typer

from app import plan_text
from app.console import WARNING, Terminal, terminal_of
from app.next import tell_next
from app.options import Folder, Json, Plot, WhereTracker
from app.report.plots import plot_plan, plot_stands
from campaigns.campaign import Campaign, open_campaign
from campaigns.options import PlanOptions, ProgramOptions
from campaigns.planning.plans import pairs_of
from campaigns.planning.stands import best_stand
from campaigns.shots.shot_sets import ShotSet
from campaigns.workflow.planning import PlannedCampaign, plan
from campaigns.workflow.planning import where_tracker as compared_stands
from campaigns.workflow.programs import write_programs


def command(
    context: typer.Context,
    folder: Folder,
    options: PlanOptions,
    programs: ProgramOptions,
    *,
    where_tracker: WhereTracker = False,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Choose the poses to measure and write plan.csv.

    Pairs for the identification, hold-out pairs all over the workspace that the fit never uses, and
    one pose at start, middle and end that shows drift. Every pose and every path is checked.

    Predicts, before anything moves, the uncertainty of parameters and positions and, if shots are
    chosen, when more of them no longer help. Defaults: `plan` in campaign.yaml. plan.csv may be
    edited and is checked again; an older one is kept.

    --program csv writes it as a table of poses and joints, by safe paths, for a controller that is
    not connected.
    """
    terminal = terminal_of(context, as_json=json)
    campaign = open_campaign(folder)
    has_more = programs.program is not None or where_tracker
    picture = None if where_tracker else plot  # of the plan; otherwise stands are drawn
    if has_more and campaign.plan_path.exists() and options == PlanOptions() and not picture:
        compared = _compare(terminal, campaign, options, plot) if where_tracker else {}
        written = _write(terminal, campaign, programs) if programs.program else {}
        terminal.document(compared | written | tell_next(terminal, campaign))
        return
    with terminal.telling("reading the campaign") as now_at:
        planned = plan(campaign, options, now_at)
    show(terminal, campaign, planned)
    terminal.say(f"written: {campaign.plan_path}")
    if picture is not None:
        own = planned.forecast
        plot_plan(picture, planned.checked.shots, own, planned.curve, campaign.space)
        terminal.say(f"drawn: {picture}")
    if planned.note:
        terminal.note(planned.note, WARNING)
    written = _write(terminal, campaign, programs) if programs.program else {}
    compared = _compare(terminal, campaign, options, plot) if where_tracker else {}
    document = plan_document(campaign, planned) | compared | written
    terminal.document(document | tell_next(terminal, campaign))


def _write(terminal: Terminal, campaign: Campaign, options: ProgramOptions) -> dict[str, object]:
    """Programs written, said and as a part of what `--json` prints."""
    written = write_programs(campaign, options)
    for each in written:
        for note in each.notes:
            terminal.note(note)
        terminal.say(
            f"written: {each.path}, {each.shots} shots, about {each.seconds / 60.0:.0f} min; the "
            f"joints that it commands: {each.joints_path}"
        )
    return {"programs": [asdict(each) for each in written]}


def _compare(
    terminal: Terminal, campaign: Campaign, options: PlanOptions, plot: Path | None
) -> dict[str, object]:
    """Stands of the tracker compared for plan.csv, said and as a part of what `--json` prints.

    Drawn, too, into a file `plot`.
    """
    with terminal.telling("comparing stands of the tracker"):
        stands = compared_stands(campaign, campaign.read_plan(), options)
    if not stands:
        terminal.say("every stand that is compared lies in the robot", WARNING)
        return {"stands": [], "best_stand": None}
    terminal.table(*plan_text.stands_table(stands))
    best = best_stand(stands)
    for line in plan_text.best_stand_lines(stands):
        terminal.say(line)
    if plot is not None:
        plot_stands(plot, stands)
        terminal.say(f"drawn: {plot}")
    return {
        "stands": [plan_text.stand_document(each) for each in stands],
        "best_stand": plan_text.stand_document(best),
    }


def plan_document(campaign: Campaign, planned: PlannedCampaign) -> dict[str, object]:
    """Plan as `--json` prints it."""
    pairs, found = len(pairs_of(planned.checked.shots, ShotSet.IDENTIFICATION)), planned.refusals
    return {
        "shots": 2 * pairs,
        "pairs": pairs,
        **plan_text.forecast_document(planned),
        "fitting_lines_mm": planned.lines_mm,
        "space": found and {**asdict(found), "by_zone": dict(found.by_zone)},
        "seconds_estimated": planned.checked.seconds,
        "path": campaign.plan_path,
    }


def show(terminal: Terminal, campaign: Campaign, planned: PlannedCampaign) -> None:
    """Show the plan: refusals, predicted uncertainty, duration."""
    if planned.refusals is not None:
        for line in plan_text.refusals_lines(campaign.space, planned.refusals):
            terminal.say(line)
    if warning := plan_text.plate_warning(campaign.space):
        terminal.say(warning, WARNING)
    if planned.lines_mm is not None:
        fitting = ", ".join(f"{mm:g}" for mm in planned.lines_mm)
        terminal.say(
            "validation.line_lengths_mm: the lines are too long for robot and space by more than a "
            f"third; [{fitting}] fit about validation.centre_mm",
            WARNING,
        )
    plan_text.show_forecast(terminal, planned)
    detours = planned.checked.detours
    terminal.say(f"{plan_text.plan_line(planned.checked)}; {detours} ways go round something")
