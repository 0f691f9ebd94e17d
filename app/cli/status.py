"""pkmcal status: where a campaign is, and the one next command."""

from collections.abc import Iterator
from dataclasses import fields

from app.console import DECISIONS, WARNING, Terminal
from campaigns.campaign import Campaign
from campaigns.evaluation.decision import NO_LIMIT
from campaigns.workflow.status import CampaignStatus, campaign_status

NOTHING_LEFT = ("nothing is left to do", "")
LATEST = 5
"""Series that are listed; `--json` has all."""


def command(terminal: Terminal, campaign: Campaign) -> None:
    """Show where the campaign is, and the next command.

    Who measures now, which series exist, what is open, what is doubtful, the verdict, and the next
    command. Nothing is changed, no device is asked, and a running measurement is not disturbed.
    """
    status = campaign_status(campaign)
    for text, style in _lines(status):
        terminal.say(text, style)
    answer = {field.name: getattr(status, field.name) for field in fields(status)}
    terminal.conclude(answer | {"answer": status.decision or ""}, status.next)


def _lines(found: CampaignStatus) -> Iterator[tuple[str, str]]:
    """Yield the lines of the answer with their styles."""
    yield f"{found.name} ({found.robot}): {found.phase}", "bold"
    if found.measuring is not None:
        yield f"now: {found.measuring.says}", WARNING
    yield from ((f"  series {s.series}, {s.says}", "") for s in found.series[-LATEST:])
    yield from ((f"open: {text}", WARNING) for text in found.open)
    yield from ((f"doubtful: {text}", WARNING) for text in found.doubtful)
    if found.decision is not None:
        if found.decision == NO_LIMIT and not found.validated:
            text = "none: the robot has not been validated after calibration"
        else:
            text = found.decision
        yield f"verdict: {text}", DECISIONS[found.decision]
    yield from ((line, "") for line in found.next.lines) if found.next else [NOTHING_LEFT]
