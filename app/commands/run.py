"""pkmcal run: measure the plan."""

from typing import TYPE_CHECKING

import typer

from app.options import Anew, Dry, Folder, Json, Yes

if TYPE_CHECKING:
    from app.console import Terminal
    from app.folder import Campaign
    from campaigns.journal import Journal
    from campaigns.plan_check import CheckedPlan
    from campaigns.session import Work
    from campaigns.shooting import Cell

CLEAR = "The robot will move. Is the cell clear?"


def command(
    context: typer.Context,
    folder: Folder,
    *,
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
    """
    from app.commands.plan import plan_line
    from app.console import terminal_of
    from app.folder import open_campaign

    terminal = terminal_of(context, as_json=json)
    campaign = open_campaign(folder)
    checked = read_checked_plan(campaign)
    terminal.note(plan_line(checked))
    if dry:
        terminal.say("the plan can be run; nothing was moved")
        terminal.document({"shots": len(checked.shots), "seconds_estimated": checked.seconds})
        return
    terminal.require_yes(CLEAR, yes=yes)
    series, shots = run_plan(campaign, checked, terminal, anew=anew)
    terminal.say(f"measured: series {series} has all {shots} shots")
    terminal.note(f"next: pkmcal identify {folder}")
    terminal.document({"series": series, "shots": shots})


def read_checked_plan(campaign: "Campaign") -> "CheckedPlan":
    """plan.csv, checked again: it may have been edited. Raises `PlanInvalid`."""
    from app.setup import checked_plan
    from campaigns.plan_file import read_plan

    return checked_plan(campaign, read_plan(campaign.plan_path))


def run_plan(
    campaign: "Campaign", checked: "CheckedPlan", terminal: "Terminal", *, anew: bool = False
) -> tuple[int, int]:
    """Measure what is missing, if anything is; gives the series and how many shots it has."""
    from app.measuring import measure
    from app.setup import plan_work

    done = None if anew else _already_measured(campaign, checked)
    if done is not None:
        terminal.note("nothing is left to measure; --anew measures all of it again")
        return done, len(checked.shots)

    def prepare(cell: "Cell") -> "Work":  # noqa: ARG001 - the plan asks nothing of the devices
        return plan_work(campaign, checked)

    def finish(journal: "Journal", series: int) -> tuple[int, int]:
        return series, len(journal.shots(series))

    again = f"pkmcal run {campaign.folder}"
    return measure(campaign, prepare, finish, terminal, title="run", again=again, anew=anew)


def _already_measured(campaign: "Campaign", checked: "CheckedPlan") -> int | None:
    """The series that has all of this plan."""
    from app.setup import plan_work
    from campaigns.journal_reader import read_journal
    from campaigns.session import nothing_left

    if not campaign.journal_path.exists():
        return None
    with read_journal(campaign.journal_path) as journal:
        done = nothing_left(journal, plan_work(campaign, checked))
    return done.number if done else None
