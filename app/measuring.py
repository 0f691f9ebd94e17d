"""Runs a series on the cell: shows progress, and asks again after Ctrl-C."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from app.console import WARNING, Terminal
from app.folder import Campaign, held, opened_journal
from app.interrupt import StopRequest, stop_on_signals
from app.wiring import connected_cell, prepare_robot, prepare_tracker
from campaigns.errors import Interrupted
from campaigns.journal.journal import Journal
from campaigns.measuring.session import Work, measure_series
from campaigns.measuring.shot_taker import Cell
from drivers.errors import Cancelled

Prepare = Callable[[Cell], Work]
Result = TypeVar("Result")
Finish = Callable[[Journal, int], Result]


def measure(
    campaign: Campaign,
    prepare: Prepare,
    finish: Finish[Result],
    terminal: Terminal,
    *,
    title: str,
    again: str,
    anew: bool,
) -> Result:
    """Connect, prepare the work, measure it, and finish with the journal still held.

    `again` is the command that goes on later. Raises `Interrupted` when the operator stopped and
    does not want to go on now.
    """
    with held(campaign):
        while True:
            wish = StopRequest()
            try:
                with (
                    stop_on_signals(wish),
                    terminal.watching(title) as display,
                    _ready_cell(campaign, wish, terminal) as cell,
                ):
                    work = prepare(cell)
                    with opened_journal(campaign) as journal:
                        series = measure_series(cell, journal, work, display, wish, anew=anew)
                        return finish(journal, series)
            except (Interrupted, Cancelled) as stopped:
                # Out here the signals do what they always do: Ctrl-C at the question means no.
                if not (wish.may_go_on and _goes_on(terminal)):
                    raise _interrupted(title, again) from stopped
                anew = False


@contextmanager
def _ready_cell(campaign: Campaign, wish: StopRequest, terminal: Terminal) -> Iterator[Cell]:
    """Both devices, connected, the tracker ready to measure, the robot ready to move."""
    with connected_cell(campaign, wish) as cell:
        terminal.detail(f"controller: {cell.robot.identity()}")
        terminal.detail(f"tracker: {cell.tracker.identity()}")
        prepare_tracker(campaign.config, cell.tracker)
        prepare_robot(cell.robot)
        yield cell


def _goes_on(terminal: Terminal) -> bool:
    terminal.note("stopped: the robot stands still, everything measured is kept", WARNING)
    return terminal.asks("Go on where it was?")


def _interrupted(title: str, again: str) -> Interrupted:
    return Interrupted(
        f"{title}: stopped by the operator; everything measured is kept",
        remedy=f"`{again}` takes up where it was",
    )
