"""pkmcal plan: where to measure."""

from dataclasses import asdict

import typer

from app import plan_text
from app.console import WARNING, Terminal, terminal_of
from app.next import tell_next
from app.options import Folder, Json, Plot
from campaigns.campaign import Campaign, open_campaign
from campaigns.measuring.stopping_rule import read_goal
from campaigns.options import PlanOptions, ProgramOptions
from campaigns.planning.plans import pairs_of
from campaigns.shots.shot_sets import ShotSet
from campaigns.workflow.planning import PlannedCampaign, plan
from campaigns.workflow.programs import write_programs


def command(
    context: typer.Context,
    folder: Folder,
    options: PlanOptions,
    programs: ProgramOptions,
    *,
    plot: Plot = None,
    json: Json = False,
) -> None:
    """Choose the poses to measure and write plan.csv.

    Pairs for the identification, hold-out pairs all over the workspace that the fit never uses, and
    one pose at start, middle and end that shows drift. Every pose and every path is checked.

    Predicts, before anything moves, the uncertainty of positions and parameters. Defaults: `plan`
    in campaign.yaml. plan.csv may be edited and is checked again; an older one is kept.

    --program csv writes it as a table of poses and joints, by safe paths, for a controller that is
    not connected.
    """
    terminal = terminal_of(context, as_json=json)
    campaign = open_campaign(folder)
    if programs.program and campaign.plan_path.exists() and options == PlanOptions() and not plot:
        terminal.document(_write(terminal, campaign, programs) | tell_next(terminal, campaign))
        return
    with terminal.telling("reading the campaign") as now_at:
        planned = plan(campaign, options, now_at)
    until_mm = None if options.until is None else read_goal(options.until)
    show(terminal, campaign, planned, until_mm)
    terminal.say(f"written: {campaign.plan_path}")
    if plot is not None:
        from app.report.plots import plot_plan  # with matplotlib

        plot_plan(plot, planned.checked.shots, planned.forecast, campaign.space)
        terminal.say(f"drawn: {plot}")
    written = _write(terminal, campaign, programs) if programs.program else {}
    document = plan_document(campaign, planned, until_mm) | written
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


def plan_document(
    campaign: Campaign, planned: PlannedCampaign, until_mm: float | None = None
) -> dict[str, object]:
    """Return the plan as `--json` prints it."""
    pairs, found = len(pairs_of(planned.checked.shots, ShotSet.IDENTIFICATION)), planned.refusals
    table = campaign.robot.mechanism.parameters
    return {
        "shots": 2 * pairs,
        "pairs": pairs,
        **plan_text.forecast_document(planned, table, until_mm),
        "fitting_lines_mm": planned.lines_mm,
        "space": found and {**asdict(found), "by_zone": dict(found.by_zone)},
        "seconds_estimated": planned.checked.seconds,
        "path": campaign.plan_path,
    }


def show(
    terminal: Terminal, campaign: Campaign, planned: PlannedCampaign, until_mm: float | None = None
) -> None:
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
    plan_text.show_forecast(terminal, campaign, planned, until_mm)
    detours = planned.checked.detours
    round_ = f"; {detours} ways go round something" if detours else ""
    terminal.say(f"{plan_text.plan_line(planned.checked)}{round_}")
