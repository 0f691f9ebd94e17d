"""pkmcal load: the compensated parameters into the controller."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated

import typer

from app.console import GOOD, Terminal
from app.interrupt import StopRequest, asking, stop_on_signals, suspend
from app.measuring import goes_on
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
from campaigns.workflow.loading import LoadResult, LoadTerms, Verification, load
from drivers.values import Identity

SURE = "Write these parameters into controller {serial}? The robot must stand still."
MOVES = (
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
    verification: Verification | None


def command(
    terminal: Terminal,
    campaign: Campaign,
    options: LoadOptions,
    *,
    dry: Dry = False,
    yes: Standing = False,
) -> None:
    """Put the compensated parameters into the controller.

    Refuses the file of another robot or campaign, one that did not pass, and parameters too far
    from the nominal ones. Shows the difference to the controller's present parameters, with Δ/σ,
    asks, keeps the old ones as controller-before-N.yaml, writes all at once, reads back and
    compares. If verification fails, the old parameters are restored. Ctrl-C acts before and after
    writing, never during it; while pairs are measured it restores the old parameters, and Ctrl-Z
    stops the robot, suspends, and asks whether to continue.

    Exit code 1: with --verify, distances after loading are worse than before; the old parameters
    are back.

    pkmcal load cell-3 --dry
    pkmcal load cell-3 --verify 8
    pkmcal load cell-3 --rollback
    """
    campaign.require_devices()
    wish = StopRequest()

    def approve(controller: Identity, found: tuple[Change, ...]) -> None:
        show(terminal, found)
        if not dry:
            question = MOVES if options.verify else SURE
            terminal.require_yes(question.format(serial=controller.serial), yes=yes)

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
            goes_on=partial(_goes_on, wish, display, terminal),
        )
        cell = connected_cell(campaign, wish, terminal.alarm, terminal.prompt(display, wish))
        done = load(campaign, cell, options, watched)
    else:
        done = load(campaign, connected_robot(campaign, terminal.prompt()), options, terms)
    _tell(terminal, done)
    if wish() and not wish.suspends:
        raise Interrupted(
            "load: interrupted once the parameters were written, and they are in",
            remedy=f"`pkmcal load {campaign.folder} --dry` says what the controller holds",
        )
    answer = LoadAnswer(
        loaded=done.source if done.kept else None,
        kept=done.kept,
        forced=done.forced,
        held=done.state,
        verification=done.verification,
    )
    terminal.conclude(answer, tell_next(terminal, campaign, held=done.state))
    if wish.suspends:
        suspend()


@contextmanager
def _watched(wish: StopRequest, display: RunLines) -> Iterator[None]:
    """Take signals for a wish to stop, and show what is measured, during the block."""
    with stop_on_signals(wish), display:
        yield


def _goes_on(wish: StopRequest, display: RunLines, terminal: Terminal) -> bool:
    """Ask after Ctrl-Z; Ctrl-C takes back at once what is not verified."""
    if not wish.suspends:
        return False
    with display.paused(), asking():
        answer = goes_on(wish, terminal)
    if answer:
        wish.withdraw()
    return answer


def _tell(terminal: Terminal, done: LoadResult) -> None:
    """Say what was done."""
    found = done.verification
    if done.outcome == "dry":
        terminal.say("nothing was written")
    elif done.outcome == "already":
        terminal.say(f"nothing was written: the controller holds these already: {done.source}")
    else:
        terminal.say(f"loaded and verified: {done.source}", GOOD)
        terminal.say(f"the previous parameters: {done.kept}")
    if found is not None:
        terminal.say(
            f"distances of {found.pairs} pairs are off by {found.after_mm:.3f} mm on average, "
            f"before it was {found.before_mm:.3f} mm",
            GOOD,
        )
    if done.state is not None:
        terminal.say(f"the controller holds {done.state.says}")


def show(terminal: Terminal, found: tuple[Change, ...]) -> None:
    """Show the parameters that would change."""
    terminal.rows("Controller (mm, deg)", CHANGES, [each for each in found if each.delta != 0.0])
