"""Runs a series on the cell: asks first, shows progress, and asks again after Ctrl-C."""

from collections.abc import Callable

from app.console import Terminal
from app.folder import Campaign, journal_of
from app.interrupt import StopWish, stop_on_signals
from app.wiring import connected_cell, prepare_tracker
from campaigns.errors import Interrupted
from campaigns.journal import Journal
from campaigns.session import Work, measure_series
from campaigns.shooting import Cell
from drivers.errors import Cancelled

Prepare = Callable[[Cell], Work]
Finish = Callable[[Journal, int], None]


def measure(
    campaign: Campaign,
    prepare: Prepare,
    finish: Finish,
    terminal: Terminal,
    *,
    title: str,
    anew: bool,
) -> None:
    """Connect, prepare the work, measure it, and finish with the journal still held.

    Raises `Interrupted` when the operator stopped and does not want to go on.
    """
    wish = StopWish()
    with journal_of(campaign) as journal, stop_on_signals(wish):
        while True:
            try:
                with connected_cell(campaign, wish) as cell:
                    prepare_tracker(campaign.config, cell.tracker)
                    work = prepare(cell)
                    with terminal.watching(title) as display:
                        series = measure_series(cell, journal, work, display, wish, anew=anew)
                finish(journal, series)
                return
            except (Interrupted, Cancelled):
                wish.forget()
                terminal.note("stopped: the robot stands still, everything measured is kept", "")
                if not terminal.confirm("Go on where it was?"):
                    raise
                anew = False
