"""pkmcal status: show where a campaign is, and the next command."""

from collections.abc import Iterator
from dataclasses import fields
from datetime import UTC, datetime

from app.console import DECISIONS, WARNING, Terminal
from campaigns.campaign import CampaignFolder
from campaigns.evaluation.decision import NO_LIMIT
from campaigns.workflow.status import CampaignStatus, folder_status

NOTHING_LEFT = ("nothing is left to do", "")
LATEST_SERIES = 5
"""Number of series that are listed; `--json` has all."""


def command(terminal: Terminal, campaign: CampaignFolder) -> None:
    """Show where the campaign is, and the next command.

    Who measures now, which series exist, what is open, what is doubtful, the verdict, and the next
    command. Nothing is changed, no device is asked, and a running measurement is not disturbed.
    """
    status = folder_status(campaign, datetime.now(UTC))
    for text, style in _lines(status):
        terminal.say(text, style)
    answer = {field.name: getattr(status, field.name) for field in fields(status)}
    terminal.conclude(answer | {"answer": status.decision or ""}, status.next)


def _lines(status: CampaignStatus) -> Iterator[tuple[str, str]]:
    """Yield the lines of the answer with their styles."""
    yield f"{status.name} ({status.robot}): {status.phase}", "bold"
    if status.measuring is not None:
        yield f"now: {status.measuring.says}", WARNING
    series = (f"series {s.series}, {s.says}" for s in status.series[-LATEST_SERIES:])
    yield from ((f"  {text}", "") for text in series if text not in status.open)
    yield from ((f"  {file.says}", "") for file in status.observations)
    yield from ((f"open: {text}", WARNING) for text in status.open)
    yield from ((f"doubtful: {text}", WARNING) for text in status.doubtful)
    if status.decision is not None:
        # without limits a campaign has no verdict; before a validation it has nothing to judge yet
        if status.decision == NO_LIMIT and not status.validated:
            text = "none: the robot has not been validated after calibration"
        else:
            text = status.decision
        yield f"verdict: {text}", DECISIONS[status.decision]
    yield from ((line, "") for line in status.next.lines) if status.next else [NOTHING_LEFT]
