"""pkmcal check: whether the robot is still calibrated, by a few shots."""

from dataclasses import asdict

import typer

from app.console import DECISIONS, terminal_of
from app.exits import Exit
from app.measuring import Job, measure
from app.next import tell_next
from app.options import Anew, Dry, Folder, Json, Plain, Yes
from app.run_text import DeviceIdentities
from campaigns.campaign import open_campaign
from campaigns.identification.checking import RecordedCheck
from campaigns.journal.journal import Journal
from campaigns.options import CheckOptions
from campaigns.workflow.checking import check_work, record_check
from campaigns.workflow.running import run_preview
from campaigns.workflow.validation import seconds_of


class CheckJob(Job[RecordedCheck]):
    """Measurement of a few shots, judged by the last identification."""

    def brief(self, devices: DeviceIdentities) -> str:
        """Say that it is a check, and of how many shots."""
        return f"Check: {super().brief(devices)}"

    def finish(self, journal: Journal, series: int) -> RecordedCheck:
        """Judge the series."""
        return record_check(self.campaign, journal, series)


def command(
    context: typer.Context,
    folder: Folder,
    options: CheckOptions,
    *,
    dry: Dry = False,
    yes: Yes = False,
    anew: Anew = False,
    plain: Plain = False,
    json: Json = False,
) -> None:
    """Test with a few shots whether the robot is still calibrated.

    The shots are spread over those of the plan. The tracker may stand anywhere, but must not move
    during the check. The last identification is their prior: if they contradict it, the parts that
    most likely changed are named. `pkmcal identify --update` then makes a new set of it.

    Exit code 1: not good, or not decided.
    """
    terminal, campaign = terminal_of(context, as_json=json), open_campaign(folder)
    campaign.require_devices()
    work = check_work(campaign, options)
    if dry:
        terminal.say(f"would measure {len(work.steps)} shots; nothing was moved")
        document = {"stage": work.stage, "shots": len(work.steps)}
        terminal.document(document | tell_next(terminal, campaign))
        return

    preview = run_preview(campaign, seconds_of(campaign, work), work, anew=anew)
    job = CheckJob(campaign, work, preview, options.retry)
    judged = measure(job, terminal, yes=yes, anew=anew, plain=plain)
    terminal.say(judged.says, DECISIONS[judged.decision])
    terminal.document(asdict(judged) | tell_next(terminal, campaign))
    if judged.decision != "pass":
        raise typer.Exit(Exit.NOT_GOOD)
