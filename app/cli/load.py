"""pkmcal load: write the compensated parameters into the controller."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from app.console import GOOD, WARNING, Terminal
from app.interrupt import StopRequest, asking, stop_on_signals, suspend
from app.measuring import wants_to_go_on
from app.next import tell_next
from app.options import Dry
from app.run_screen import RunLines
from app.wiring import connected_cell, connected_robot, prepare
from campaigns.campaign import Campaign
from campaigns.controllers.controller_state import ControllerState
from campaigns.controllers.load import Change
from campaigns.errors import Interrupted
from campaigns.files.table import Column, words
from campaigns.options import LoadOptions
from campaigns.workflow.loading import LoadResult, LoadTerms, LoadVerification, load
from drivers.values import Identity

QUESTION = "Write these parameters into controller {serial}? The robot must stand still."
QUESTION_BEFORE_MOTION = (
    "Measure pairs, write these parameters into controller {serial}, measure again? "
    "The robot will move: is it clear?"
)

Standing = Annotated[bool, typer.Option("--yes", "-y", help="Do not ask: the robot stands still.")]
CHANGES: tuple[Column[Change], ...] = (
    words("", lambda change: change.name),
    Column("holds", lambda change: change.old, decimals=4),
    Column("will hold", lambda change: change.new, decimals=4),
    Column("Δ", lambda change: change.delta, decimals=4, signed=True),
    Column("Δ/σ", lambda change: change.in_sigmas, decimals=0, signed=True),
)


@dataclass(frozen=True, slots=True, kw_only=True)
class LoadAnswer:
    """Answer of `load`: what was written, and what the controller holds now."""

    loaded: Path | None
    kept: Path | None
    forced: tuple[str, ...]
    held: ControllerState | None
    verification: LoadVerification | None


def command(
    terminal: Terminal,
    campaign: Campaign,
    options: LoadOptions,
    *,
    dry: Dry = False,
    yes: Standing = False,
) -> None:
    """Put the compensated parameters into the controller.

    Refuses, before anything is sent, the file of another robot or campaign or of an earlier
    identification, one that did not pass, and parameters too far from the nominal ones. Shows the
    difference to the controller's present parameters, with Δ/σ, asks, keeps the old ones as
    controller-before-N.yaml, writes all at once, reads back and compares. If verification fails,
    the old parameters are restored. Ctrl-C acts before and after writing, never during it; while
    pairs are measured it restores the old parameters, and Ctrl-Z stops the robot, suspends, and
    asks whether to continue.

    Exit code 1: with --verify, distances after loading are worse than before; the old parameters
    are back.

    pkmcal load cell-3 --dry
    pkmcal load cell-3 --verify 8
    pkmcal load cell-3 --rollback
    """
    campaign.require_devices()
    wish = StopRequest()

    def approve(controller: Identity, changes: tuple[Change, ...]) -> None:
        show(terminal, changes)
        if not dry:
            question = QUESTION_BEFORE_MOTION if options.verify else QUESTION
            terminal.require_yes(question.format(serial=controller.serial), yes=yes)

    # `uninterrupted` holds from the first to the last record of the load: a signal there only sets
    # the wish, because a load that ended half-way would leave parameters that were not compared.
    terms = LoadTerms(
        approve=approve, tell=terminal.note, uninterrupted=stop_on_signals(wish), dry=dry
    )
    if options.verify and not dry:
        display = terminal.watching("load", plain=campaign.is_by_hand)
        watched = replace(
            terms,
            uninterrupted=_watched(wish, display),
            prepare=partial(prepare, campaign),
            observer=display,
            stop_requested=wish,
            goes_on=partial(_wants_to_go_on, wish, display, terminal),
        )
        cell = connected_cell(campaign, wish, terminal.alarm, terminal.prompt(display, wish))
        done = load(campaign, cell, options, watched)
    else:
        done = load(campaign, connected_robot(campaign, terminal.prompt()), options, terms)
    _show_outcome(terminal, done)
    if wish() and not wish.suspends:
        raise Interrupted(
            "load: interrupted once the parameters were written, and they are in",
            remedy="`pkmcal load DIR --dry` says what the controller holds",
        )
    answer = LoadAnswer(
        loaded=done.source if done.kept else None,
        kept=done.kept,
        forced=done.forced,
        held=done.state,
        verification=done.verification,
    )
    terminal.conclude(answer, tell_next(terminal, campaign, held=done.state))
    if wish.suspends:  # Ctrl-Z while the parameters were written: all is done, suspend now
        suspend()


@contextmanager
def _watched(wish: StopRequest, display: RunLines) -> Iterator[None]:
    """Turn signals into a wish to stop, and show the measurement, for the time of the block."""
    with stop_on_signals(wish), display:
        yield


def _wants_to_go_on(wish: StopRequest, display: RunLines, terminal: Terminal) -> bool:
    """Return whether measuring goes on after Ctrl-Z; after Ctrl-C it never does.

    A no restores the old parameters, because the new ones are not verified yet.
    """
    if not wish.suspends:
        return False
    with display.paused(), asking():
        goes_on = wants_to_go_on(wish, terminal)
    if goes_on:
        wish.withdraw()
    return goes_on


def _show_outcome(terminal: Terminal, done: LoadResult) -> None:
    """Print what was written and how the pairs compare."""
    verification = done.verification
    if done.outcome == "dry":
        terminal.say("nothing was written")
    elif done.outcome == "already":
        terminal.say(f"nothing was written: the controller holds these already: {done.source}")
    else:
        terminal.say(f"loaded and verified: {done.source}", GOOD)
        terminal.say(f"the previous parameters: {done.kept}")
    if verification is not None:
        is_better = verification.change == "smaller"
        kept = "" if is_better else "; no change shown: the new parameters are kept"
        terminal.say(
            f"distances of {verification.pairs} pairs are off by {verification.after_mm:.3f} mm on "
            f"average, before it was {verification.before_mm:.3f} mm (U of the difference: "
            f"{verification.expanded_mm:.3f} mm){kept}",
            GOOD if is_better else WARNING,
        )
    if done.state is not None:
        terminal.say(f"the controller holds {done.state.says}")


def show(terminal: Terminal, changes: tuple[Change, ...]) -> None:
    """Show the parameters that would change."""
    differing = [change for change in changes if change.delta != 0.0]
    terminal.rows("Controller (mm, deg)", CHANGES, differing)
