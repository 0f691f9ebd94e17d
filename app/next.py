"""Next command, named at the end of every command, and who else works on a campaign meanwhile."""

from dataclasses import replace
from typing import TYPE_CHECKING

from app.console import WARNING, Terminal
from campaigns.campaign import Campaign, CampaignFolder
from campaigns.errors import CampaignError
from campaigns.files.lock import lock_holder
from campaigns.settings.instrument import StatedInstrument

if TYPE_CHECKING:  # help needs no next command: the checks of all commands would be loaded for it
    from campaigns.assessment import Evaluation
    from campaigns.controllers.controller_state import ControllerState
    from campaigns.next_step import NextStep

BY_DEFAULT = (
    "in campaign.yaml names no data sheet: U will rest on default limits, by which no certificate "
    "is issued; state them before you measure"
)


def tell_who_works(terminal: Terminal, campaign: CampaignFolder) -> None:
    """Note which other process works on the campaign, whose files may change at any moment."""
    held_by = lock_holder(campaign.folder)
    if held_by is not None:
        terminal.note(f"! another process works on this campaign now: {held_by.says}", WARNING)


def tell_source_of_u(terminal: Terminal, campaign: CampaignFolder) -> None:
    """Note that points typed or read from a file will have the U of default limits."""
    tracker = campaign.config.tracker
    stated = StatedInstrument.of(tracker)
    if tracker.states_no_uncertainty and stated.of_shot.source == "default":
        words = "such points have no uncertainty of their own, and tracker.uncertainty"
        terminal.note(f"! {words} {BY_DEFAULT}", WARNING)
    certificate = campaign.config.certificate
    if certificate.is_asked and stated.of_all.source == "default":
        terminal.note(f"! tracker.common {BY_DEFAULT}", WARNING)


def tell_next(
    terminal: Terminal,
    campaign: Campaign,
    *,
    reported: bool | None = None,
    held: "ControllerState | None" = None,
    evaluation: "Evaluation | None" = None,
    answered: bool = False,
) -> "NextStep | None":
    """Print which command is next, and return it for `--json`; None if none is known.

    `reported` and `held` as for `state_of`; `evaluation`: the campaign's, if already made;
    `answered`: whether both devices answered just now.
    """
    from campaigns.assessment import evaluate
    from campaigns.next_step import state_of
    from campaigns.workflow.next_hint import next_hint

    try:
        state = state_of(evaluation or evaluate(campaign), reported=reported, held=held)
        worker = lock_holder(campaign.folder)
        state = replace(state, worker=worker.says if worker else "", answered=answered)
        step = next_hint(campaign, state)
    except CampaignError:
        # evidence that cannot be read must not turn a command that has succeeded into a failure
        return None
    return step and tell_step(terminal, step)


def tell_step(terminal: Terminal, step: "NextStep") -> "NextStep":
    """Print a next command, and return it."""
    for line in step.lines:
        terminal.note(line)
    return step
