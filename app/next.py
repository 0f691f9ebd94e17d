"""Next command, named at the end of every command, and who else works on a campaign meanwhile."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from pydantic_core import to_jsonable_python

from app.console import TALK, WARNING, Terminal
from app.remembered import Answer, answer_to
from campaigns.campaign import Campaign
from campaigns.errors import CampaignError
from campaigns.files.lock import lock_holder

if TYPE_CHECKING:
    from campaigns.controllers.controller_state import ControllerState
    from campaigns.evidence import Evaluation
    from campaigns.next_step import NextStep, WayOn


def tell_who_works(terminal: Terminal, campaign: Campaign) -> None:
    """Say which other process works on the campaign: what is read may change at any moment."""
    held_by = lock_holder(campaign.folder)
    if held_by is not None:
        terminal.note(f"! another process works on this campaign now: {held_by.says}", WARNING)


def tell_next(
    terminal: Terminal,
    campaign: Campaign,
    *,
    words: Sequence[str] = (),
    answered: bool = False,
    reported: bool = False,
    held: "ControllerState | None" = None,
    evaluation: "Evaluation | None" = None,
) -> dict[str, object]:
    """Say which command is next; gives it as a part of what `--json` prints.

    `words`: options that a next run or identification gets, not those recorded. `answered`: the
    devices answered, and the campaign's files stayed as they were, so that it is remembered.
    `held`: what was read from the controller. `evaluation`: the campaign's, where it is there.
    Where evidence cannot be read, nothing is said: the command's own result stands.
    """

    def find() -> Answer:
        # all that judges, which a remembered answer spares
        from campaigns.campaign_state import present_state, state_of
        from campaigns.next_step import next_step

        known = {"answered": answered, "reported": reported}
        if evaluation is None:
            state = present_state(campaign, held=held, **known)
        else:
            state = state_of(evaluation, held=held, **known)
        step = next_step(replace(state, words=tuple(words) or state.words))
        ways = state.ways if state.verdict == "not decided" else ()
        lines = [(way.says, TALK) for way in ways]
        if step is not None:
            lines.append((f"next: {step.says}", TALK))
        document = next_document(step, ways)
        if not ways:
            del document["ways"]
        return lines, to_jsonable_python(document)

    try:
        lines, document = answer_to("next", campaign.folder, find) if answered else find()
    except CampaignError:
        return {"next": None, "before_next": None}
    for text, style in lines:
        terminal.note(text, style)
    return document


def next_document(step: "NextStep | None", ways: "Sequence[WayOn]") -> dict[str, object]:
    """The next step and the ways on for programs."""
    return {
        "next": step and step.text,
        "before_next": (step and step.first) or None,
        "ways": [way.document for way in ways],
    }
