"""Measuring on the cell: a series with its progress shown, and asked about again after Ctrl-C."""

import math
import signal
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from typing import TypeVar

from app.console import WARNING, Terminal, is_yes
from app.interrupt import StopRequest, stop_on_signals, suspend
from app.progress import RunDisplay
from app.retrying import Retries
from app.run_screen import STOP_KEY
from app.run_text import DeviceIdentities, briefing, serials
from app.wiring import connected_cell, prepare, require_devices
from campaigns.campaign import Campaign
from campaigns.errors import CampaignError, Interrupted, OptionsInvalid
from campaigns.journal.journal import Journal
from campaigns.journal.records import Stage
from campaigns.measuring.session import RunResult, measure_series, run_result
from campaigns.measuring.wishes import Wish, Wishes
from campaigns.measuring.work import Cell, Work
from campaigns.options import RunOptions, ValidationOptions
from campaigns.planning.plan_check import CheckedPlan
from campaigns.workflow import validation
from campaigns.workflow.running import RunPreview, measured_before, run_preview, run_work
from drivers.errors import Cancelled, DriverError, ExplainedError, WrongDevice
from drivers.ports import Prompt, SystemClock

Prepare = Callable[[Cell], Work]
Result = TypeVar("Result")
Finish = Callable[[Journal, int], Result]
Briefing = Callable[[DeviceIdentities], str]


def measure(
    campaign: Campaign,
    make_work: Prepare,
    finish: Finish[Result],
    terminal: Terminal,
    *,
    title: str,
    stage: Stage,
    retry: int | None,
    told: Briefing,
    yes: bool,
    anew: bool,
    plain: bool,
) -> Result:
    """Connect, make the work, measure it, and finish with the journal still held.

    `retry`: so often it connects anew after a lost link; None: as campaign.yaml says. `told`: what
    the operator is told before he is asked, unless it is a `yes`. `plain` shows it by lines, and
    hears no keys.
    Raises `Interrupted` when the operator stopped and does not want to go on now.
    """
    allowed = campaign.config.run.retry if retry is None else retry
    retries, clearance = Retries(campaign, stage, allowed, SystemClock()), Clearance(told, yes=yes)
    with campaign.held():
        require_devices(campaign)  # before anything is shown that goes on while it asks
        clearance.obtain(campaign, terminal)
        before = _latest_series(campaign)

        def measure_once(wish: StopRequest, *, anew: bool) -> Result:
            wishes = Wishes()
            with (
                terminal.watching(title, plain=plain or campaign.is_by_hand) as display,
                _keys(terminal, display, wish, wishes),
                _ready_cell(
                    campaign, wish, terminal, clearance, prompt := terminal.prompt(display, wish)
                ) as cell,
            ):
                work = make_work(cell)
                if prompt is not None:
                    cell = replace(cell, ask=partial(_says_yes, prompt))
                    if not yes:
                        cell = replace(cell, beam_wait_s=math.inf)
                with campaign.opened_journal() as journal:
                    series = measure_series(
                        cell, journal, work, display, wish, anew=anew, wishes=wishes
                    )
                    return finish(journal, series)

        while True:
            wish = StopRequest()
            is_new = anew and _latest_series(campaign) == before
            try:
                with stop_on_signals(wish):
                    try:
                        return measure_once(wish, anew=is_new)
                    except (Interrupted, Cancelled):
                        raise
                    except (DriverError, CampaignError) as error:
                        _wait_for_next_try(error, retries, terminal, wish)
            except (Interrupted, Cancelled) as stopped:
                if not (wish.may_go_on and _wants_to_go_on(wish, terminal)):
                    raise Interrupted(
                        f"{title}: stopped by the operator; everything measured is kept",
                        remedy="type the same command again to resume it",
                    ) from stopped


def _says_yes(prompt: Prompt, question: str) -> bool:
    """Ask the operator while the run is shown; raises `Cancelled` once a stop is requested."""
    return is_yes(prompt(f"{question} [y/N] "))


WISH_OF_KEY = {"p": Wish.PAUSE, "s": Wish.SKIP, "r": Wish.AGAIN, "k": Wish.PARK}


@contextmanager
def _keys(
    terminal: Terminal, display: RunDisplay, stop: StopRequest, wishes: Wishes
) -> Iterator[None]:
    """Keys as wishes of the operator while the screen names them; q stops at once, as Ctrl-C."""

    def pressed(key: str) -> None:
        display.answer(key)
        if key == STOP_KEY:
            stop.ask(signal.SIGINT)
        elif key in WISH_OF_KEY:
            wishes.ask(WISH_OF_KEY[key])

    if not display.has_screen:
        yield
        return
    with terminal.hearing(pressed):
        yield


def _wait_for_next_try(
    error: ExplainedError, retries: Retries, terminal: Terminal, wish: StopRequest
) -> None:
    """Wait until it is tried again; raises the error when it is not, `Interrupted` when stopped."""
    pause_s = retries.again_after(error)
    if pause_s is None:
        raise error
    terminal.note(f"! {retries.text(error)}", WARNING)
    retries.wait(pause_s, wish)


def _latest_series(campaign: Campaign) -> int:
    """Number of the series that was begun last, of any stage; 0: none was."""
    if not campaign.journal_path.exists():
        return 0
    with campaign.journal_reader() as journal:
        return max((series.number for series in journal.series()), default=0)


def identities(cell: Cell) -> DeviceIdentities:
    """Ask both devices of a connected cell who they are."""
    return cell.robot.identity(), cell.tracker.identity()


class Clearance:
    """The operator's yes to a robot that will move, given by an option or asked for.

    He is told which devices answer before he is asked; it must be these that are measured with.
    """

    def __init__(self, briefing: Briefing, *, yes: bool) -> None:
        self._briefing = briefing
        self._yes = yes
        self._told: DeviceIdentities | None = None

    def obtain(self, campaign: Campaign, terminal: Terminal) -> None:
        """Ask, unless it was given; raises `NotConfirmed`. Connects, and moves nothing."""
        if self._yes:
            return
        terminal.require_somebody()
        with connected_cell(campaign) as cell:
            self._told = identities(cell)
        terminal.require_yes(f"{self._briefing(self._told)}. Is the cell clear?", yes=False)

    def check(self, found: DeviceIdentities, terminal: Terminal) -> None:
        """Raise `WrongDevice` for others than were told; tell whoever has not been asked."""
        if self._told is None:
            self._told = found
            terminal.note(self._briefing(found))
        if found != self._told:
            raise WrongDevice(
                f"{serials(found)} answer now, before the question it was {serials(self._told)}",
                remedy="check the addresses, then start again",
            )


@contextmanager
def _ready_cell(
    campaign: Campaign,
    wish: StopRequest,
    terminal: Terminal,
    clearance: Clearance,
    prompt: Prompt | None,
) -> Iterator[Cell]:
    """Both devices, connected, the tracker ready to measure, the robot ready to move."""
    with connected_cell(campaign, wish, terminal.alarm, prompt) as cell:
        found = identities(cell)
        for device, identity in zip(("controller", "tracker"), found, strict=True):
            terminal.detail(f"{device}: {identity}")
        clearance.check(found, terminal)
        prepare(campaign, cell)
        yield cell


def goes_on(wish: StopRequest, terminal: Terminal) -> bool:
    """Whether the operator wants to go on; suspended first, if that was his wish."""
    terminal.note("stopped: the robot stands still, everything measured is kept", WARNING)
    if wish.suspends:
        suspend()
        terminal.note("continued: the robot still stands where it was stopped", WARNING)
    return terminal.asks("Go on where it was?")


def _wants_to_go_on(wish: StopRequest, terminal: Terminal) -> bool:
    """The operator's answer. Signals are not caught here, so Ctrl-C means no."""
    try:
        return goes_on(wish, terminal)
    except KeyboardInterrupt:
        return False


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
    if before is not None:
        return before
    preview = run_preview(campaign, checked.seconds, work)
    return measure_plan(campaign, preview, work, terminal, options, yes=True, plain=True)


def measure_plan(
    campaign: Campaign,
    preview: RunPreview,
    work: Work,
    terminal: Terminal,
    options: RunOptions,
    *,
    yes: bool,
    anew: bool = False,
    plain: bool = False,
) -> RunResult:
    """Take up the unfinished series, or begin one, with the operator's yes."""
    return measure(
        campaign,
        lambda _: work,  # the plan asks nothing of the devices
        partial(run_result, work=work),
        terminal,
        title="run",
        stage="run",
        retry=options.retry,
        told=partial(briefing, campaign, work, preview),
        yes=yes,
        anew=anew,
        plain=plain,
    )


def measure_validation(
    campaign: Campaign,
    terminal: Terminal,
    options: ValidationOptions,
    held: Mapping[str, float],
    objections: Sequence[OptionsInvalid] = (),
    *,
    yes: bool,
    anew: bool = False,
    plain: bool = False,
) -> validation.Validated:
    """Measure, with the operator's yes, evaluate and judge.

    `held`: what the controller holds. What is done in spite of `objections` the journal keeps.
    """
    unsaid = [*objections]

    def prepare(cell: Cell) -> Work:
        with campaign.opened_journal() as journal:
            while unsaid:
                validation.record_objection(journal, unsaid.pop(0))
        work, notes = validation.validation_work(campaign, cell.robot.read_geometry(), options)
        for note in notes:
            terminal.note(f"! {note}", WARNING)
        return work

    def finish(journal: Journal, series: int) -> validation.Validated:
        return validation.record_validation(campaign, journal, series, options.stage, options.by)

    def told(devices: DeviceIdentities) -> str:
        work, _ = validation.validation_work(campaign, held, options)
        preview = run_preview(campaign, validation.seconds_of(campaign, work), work, anew=anew)
        return f"Validation '{options.stage}': {briefing(campaign, work, preview, devices)}"

    return measure(
        campaign,
        prepare,
        finish,
        terminal,
        title=f"validate {options.stage}",
        stage=options.stage,
        retry=options.retry,
        told=told,
        yes=yes,
        anew=anew,
        plain=plain,
    )
