"""pkmcal check: test with a few shots whether the robot is still calibrated."""

from dataclasses import dataclass

from app.console import DECISIONS, WARNING, Terminal
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
    """Measurement of a few shots, compared with the last identification."""

    def brief(self, devices: DeviceIdentities) -> str:
        """Return the briefing, which begins with the word Check."""
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
    during the check; left where it stood, it shows smaller changes. The shots are compared with the
    last identification: if they contradict it, the parts that most likely changed are named.
    `pkmcal identify --update` then updates the parameters.

    Exit code 1: the robot has changed, or the shots do not decide whether it has. Shots that
    contradict all others (`wrong` in --json) decide nothing: check again.
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
    show_check(terminal, campaign, measure(job, terminal, yes=yes, anew=anew, plain=plain))


def show_check(terminal: Terminal, campaign: Campaign, check: RecordedCheck) -> None:
    """Show a check, for people and programs, and what is next; raise `Exit` unless it passed."""
    terminal.say(check.says, DECISIONS[check.decision])
    if not check.is_of_shots_alone:  # else these words are about the shots
        for shot in check.wrong:
            terminal.say(f"left out: shot {shot}: it contradicts all others", WARNING)
    # "not decided" ends with code 1 as well: a script must not take it for a robot that is fine
    following = tell_next(terminal, campaign)
    terminal.conclude(check, following, is_good=check.decision == "pass")
