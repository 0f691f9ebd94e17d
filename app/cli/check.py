"""pkmcal check: whether the robot is still calibrated, by a few shots."""

from dataclasses import dataclass

from app.console import DECISIONS, Terminal
from app.measuring import Job, measure
from app.next import tell_next
from app.options import Anew, Dry, Plain, Yes
from app.run_text import DeviceIdentities
from campaigns.campaign import Campaign
from campaigns.identification.checking import RecordedCheck
from campaigns.journal.journal import Journal
from campaigns.options import CheckOptions
from campaigns.workflow.checking import check_work, record_check
from campaigns.workflow.running import run_preview
from campaigns.workflow.validation import seconds_of


@dataclass(frozen=True, slots=True)
class CheckPreview:
    """Answer of `check --dry`."""

    stage: str
    shots: int


class CheckJob(Job[RecordedCheck]):
    """Measurement of a few shots, judged by the last identification."""

    def brief(self, devices: DeviceIdentities) -> str:
        """Say that it is a check, and of how many shots."""
        return f"Check: {super().brief(devices)}"

    def finish(self, journal: Journal, series: int) -> RecordedCheck:
        """Judge the series."""
        return record_check(self.campaign, journal, series)


def command(
    terminal: Terminal,
    campaign: Campaign,
    options: CheckOptions,
    *,
    dry: Dry = False,
    yes: Yes = False,
    anew: Anew = False,
    plain: Plain = False,
) -> None:
    """Test with a few shots whether the robot is still calibrated.

    The shots are spread over those of the plan. The tracker may stand anywhere, but must not move
    during the check. The last identification is their prior: if they contradict it, the parts that
    most likely changed are named. `pkmcal identify --update` then makes a new set of it.

    Exit code 1: not good, or not decided.
    """
    campaign.require_devices()
    work = check_work(campaign, options)
    if dry:
        terminal.say(f"would measure {len(work.steps)} shots; nothing was moved")
        preview = CheckPreview(work.stage, len(work.steps))
        terminal.conclude(preview, tell_next(terminal, campaign))
        return
    expected = run_preview(campaign, seconds_of(campaign, work), work, anew=anew)
    job = CheckJob(campaign, work, expected, options.retry)
    judged = measure(job, terminal, yes=yes, anew=anew, plain=plain)
    terminal.say(judged.says, DECISIONS[judged.decision])
    following = tell_next(terminal, campaign)
    terminal.conclude(judged, following, is_good=judged.decision == "pass")
