"""Measuring on the cell: a series with its progress shown, and asked about again after Ctrl-C."""

import shlex
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TypeVar

from app.console import WARNING, Terminal
from app.interrupt import StopRequest, stop_on_signals, suspend
from app.wiring import connected_cell, prepare
from campaigns.campaign import Campaign
from campaigns.chain.running import measured_before, run_work
from campaigns.chain.validation import (
    TESTS,
    Validated,
    ValidationStage,
    record_validation,
    validation_work,
)
from campaigns.errors import Interrupted
from campaigns.journal.journal import Journal
from campaigns.measuring.session import RunResult, Work, measure_series, run_result
from campaigns.measuring.shot_taker import Cell
from campaigns.options import RunOptions
from campaigns.planning.plan_check import CheckedPlan
from campaigns.shots.shot_sets import ShotSet
from drivers.errors import Cancelled

CLEAR = "The robot will move. Is the cell clear?"

Prepare = Callable[[Cell], Work]
Result = TypeVar("Result")
Finish = Callable[[Journal, int], Result]


def measure(
    campaign: Campaign,
    make_work: Prepare,
    finish: Finish[Result],
    terminal: Terminal,
    *,
    title: str,
    again: str,
    anew: bool,
) -> Result:
    """Connect, make the work, measure it, and finish with the journal still held.

    `again` is the command that goes on later. Raises `Interrupted` when the operator stopped and
    does not want to go on now.
    """
    with campaign.held():
        while True:
            wish = StopRequest()
            try:
                with (
                    stop_on_signals(wish),
                    terminal.watching(title) as display,
                    _ready_cell(campaign, wish, terminal) as cell,
                ):
                    work = make_work(cell)
                    with campaign.opened_journal() as journal:
                        series = measure_series(cell, journal, work, display, wish, anew=anew)
                        return finish(journal, series)
            except (Interrupted, Cancelled) as stopped:
                # Out here the signals do what they always do: Ctrl-C at the question means no.
                if not (wish.may_go_on and _goes_on(wish, terminal)):
                    raise _interrupted(title, again) from stopped
                anew = False


@contextmanager
def _ready_cell(campaign: Campaign, wish: StopRequest, terminal: Terminal) -> Iterator[Cell]:
    """Both devices, connected, the tracker ready to measure, the robot ready to move."""
    with connected_cell(campaign, wish) as cell:
        terminal.detail(f"controller: {cell.robot.identity()}")
        terminal.detail(f"tracker: {cell.tracker.identity()}")
        prepare(campaign, cell)
        yield cell


def _goes_on(wish: StopRequest, terminal: Terminal) -> bool:
    terminal.note("stopped: the robot stands still, everything measured is kept", WARNING)
    if wish.suspends:
        suspend()
        terminal.note("continued: the robot still stands where it was stopped", WARNING)
    return terminal.asks("Go on where it was?")


def _interrupted(title: str, again: str) -> Interrupted:
    return Interrupted(
        f"{title}: stopped by the operator; everything measured is kept",
        remedy=f"`{again}` takes up where it was",
    )


def found_measured(campaign: Campaign, work: Work, terminal: Terminal) -> RunResult | None:
    """Result that was measured before, if nothing is left; says so."""
    ran = measured_before(campaign, work)
    if ran is not None:
        more = (
            "a run without --until takes the rest"
            if ran.left_out
            else "--anew takes all of it again"
        )
        terminal.note(f"nothing is left to measure; {more}")
    return ran


def run_plan(campaign: Campaign, checked: CheckedPlan, terminal: Terminal) -> RunResult:
    """Measure all of the plan that is missing."""
    options = RunOptions()
    work = run_work(campaign, checked, options)
    before = found_measured(campaign, work, terminal)
    return before or measure_plan(campaign, work, terminal, options)


def measure_plan(
    campaign: Campaign,
    work: Work,
    terminal: Terminal,
    options: RunOptions,
    *,
    anew: bool = False,
) -> RunResult:
    """Take up the unfinished series, or begin one."""

    def prepare(cell: Cell) -> Work:  # noqa: ARG001 - the plan asks nothing of the devices
        return work

    def finish(journal: Journal, series: int) -> RunResult:
        return run_result(journal, series, work)

    again = shlex.join(["pkmcal", "run", str(campaign.folder), *options.run_words()])
    return measure(campaign, prepare, finish, terminal, title="run", again=again, anew=anew)


def measure_validation(
    campaign: Campaign,
    stage: ValidationStage,
    terminal: Terminal,
    tests: frozenset[ShotSet] = TESTS,
    *,
    again: str,
    anew: bool = False,
) -> Validated:
    """Measure, evaluate and judge; `again` is the command that goes on later."""

    def prepare(cell: Cell) -> Work:
        work, notes = validation_work(campaign, stage, cell.robot.read_geometry(), tests)
        for note in notes:
            terminal.note(f"! {note}", WARNING)
        return work

    def finish(journal: Journal, series: int) -> Validated:
        return record_validation(campaign, journal, series, stage)

    title = f"validate {stage}"
    return measure(campaign, prepare, finish, terminal, title=title, again=again, anew=anew)
