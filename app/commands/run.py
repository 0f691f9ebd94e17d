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

MINUTE_S = 60.0


def command(
    folder: Folder, *, dry: Dry = False, yes: Yes = False, anew: Anew = False, json: Json = False
) -> None:
    """Measure what the plan still lacks; a second run resumes.

    Every shot is in the journal (campaign.db) before the next motion. Ctrl-C stops the robot at
    once and then asks. After a restart the drift pose is measured first and compared.
    """
    from app.console import Terminal
    from app.folder import open_campaign

    terminal = Terminal(as_json=json)
    campaign = open_campaign(folder)
    checked = read_checked_plan(campaign)
    minutes = checked.seconds / MINUTE_S
    terminal.note(f"{len(checked.shots)} shots, about {minutes:.0f} min on {_devices(campaign)}")
    if dry:
        terminal.say("the plan can be run; nothing was moved")
        terminal.document({"shots": len(checked.shots), "seconds_estimated": checked.seconds})
        return
    if not yes and not terminal.confirm("The robot will move. Is the cell clear?"):
        raise typer.BadParameter("not confirmed: answer y, or give --yes")
    terminal.document(run_plan(campaign, checked, terminal, anew=anew))


def read_checked_plan(campaign: "Campaign") -> "CheckedPlan":
    """plan.csv, checked again: it may have been edited. Raises `PlanInvalid`."""
    from app.setup import checked_plan
    from campaigns.plan_file import read_plan

    return checked_plan(campaign, read_plan(campaign.plan_path))


def run_plan(
    campaign: "Campaign", checked: "CheckedPlan", terminal: "Terminal", *, anew: bool = False
) -> dict[str, object]:
    """Measure the plan, or say that nothing is left; gives what `--json` prints."""
    from app.measuring import measure

    done = None if anew else _already_measured(campaign, checked)
    if done is not None:
        terminal.say(f"nothing left to measure: series {done} has all {len(checked.shots)} shots")
        return {"series": done, "shots": len(checked.shots), "measured_now": 0}
    result: dict[str, object] = {}

    def finish(journal: "Journal", series: int) -> None:
        shots = journal.shots(series)
        result.update({"series": series, "shots": len(shots)})
        terminal.say(f"series {series}: {len(shots)} shots measured", "green")
        terminal.note(f"next: pkmcal identify {campaign.folder}")

    def prepare(cell: "Cell") -> "Work":  # noqa: ARG001 - the plan asks nothing of the devices
        return plan_work(campaign, checked)

    measure(campaign, prepare, finish, terminal, title="run", anew=anew)
    return result


def plan_work(campaign: "Campaign", checked: "CheckedPlan") -> "Work":
    """The plan as work for the engine."""
    from app.setup import mechanism_of
    from campaigns.plan_file import plan_digest
    from campaigns.planning import numeric_geometry
    from campaigns.rules import gate_rules, motion_rules
    from campaigns.session import Work
    from campaigns.steps import joint_steps

    robot = campaign.nominal.robot
    return Work(
        "run",
        joint_steps(checked.shots),
        plan_digest(checked.shots),
        robot.digest(),
        campaign.config.model_dump(mode="json"),
        mechanism_of(campaign, numeric_geometry(robot)),
        motion_rules(campaign.config),
        gate_rules(campaign.config),
    )


def _already_measured(campaign: "Campaign", checked: "CheckedPlan") -> int | None:
    from app.folder import JOURNAL
    from campaigns.journal_reader import read_journal
    from campaigns.session import nothing_left

    path = campaign.path(JOURNAL)
    if not path.exists():
        return None
    with read_journal(path) as journal:
        done = nothing_left(journal, plan_work(campaign, checked))
    return done.number if done else None


def _devices(campaign: "Campaign") -> str:
    return f"{campaign.config.controller.url} and {campaign.config.tracker.url}"
