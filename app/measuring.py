"""Measuring on the cell: a job measured with its progress shown, resumed after lost links."""

# `measure` runs a job: one stage of a campaign (run, validation, check) with its devices.
#
# 1. Hold the campaign, so that no second process commands the same robot.
# 2. Ask for clearance: connect, name the devices that answer, ask whether the cell is clear. The
#    connection is closed while the operator thinks; the same devices must answer afterwards.
# 3. Connect, prepare, measure what the series still lacks, finish the job: `_measure_once`.
# 4. After an error that may be over soon (a lost link, a drive's fault), wait and begin again at 3.
#    Nothing is remembered between two tries: the journal says what is measured, so a try after a
#    lost link is no different from a run that is started again the next day.
# 5. After Ctrl-C or Ctrl-Z, when the robot stands, ask whether to go on; if so, begin again at 3.
#
# Signals and keys never act on the robot themselves: they set a `StopRequest` or a `Wish` at which
# the engine looks between its steps, and which drivers look at while they wait.

import math
import signal
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from typing import Generic, TypeVar

from typing_extensions import override

from app.console import WARNING, Terminal, is_yes
from app.interrupt import StopRequest, stop_on_signals, suspend
from app.keyboard import KEYBOARD
from app.retrying import Retries
from app.run_screen import STOP_KEY, RunLines
from app.run_text import DeviceIdentities, briefing, serials
from app.wiring import connected_cell, pause_clock, prepare, read_by_hand
from campaigns.campaign import Campaign
from campaigns.errors import CampaignError, Interrupted, OptionsInvalid
from campaigns.journal.journal import Journal
from campaigns.measuring.observing import ObservationResult, Observing
from campaigns.measuring.run_state import Wish, Wishes
from campaigns.measuring.session import RunResult, measure_series, run_result
from campaigns.measuring.work import Devices, Work
from campaigns.options import RunOptions, ValidationOptions
from campaigns.planning.plan_check import CheckedPlan
from campaigns.workflow import validation
from campaigns.workflow.observation_run import fill_in, observation_work, planned_observations
from campaigns.workflow.running import RunPreview, measured_before, run_preview, run_work
from drivers.errors import Cancelled, DriverError, ExplainedError, WrongDevice
from drivers.ports import BACK, Prompt

Result = TypeVar("Result")
WISH_OF_KEY = {"p": Wish.PAUSE, "s": Wish.SKIP, "r": Wish.AGAIN, "k": Wish.PARK}


class DeviceJob(ABC, Generic[Result]):
    """What is measured with the devices of a campaign, once they are connected."""

    def __init__(self, campaign: Campaign, title: str, retry: int | None) -> None:
        """`retry`: how often to connect again after a lost link; None: as campaign.yaml says."""
        self.campaign, self.title = campaign, title
        self.retry = campaign.config.run.retry if retry is None else retry

    @abstractmethod
    def brief(self, devices: DeviceIdentities) -> str:
        """Say what will be measured with these devices, before the operator is asked."""

    @abstractmethod
    def measure(self, cell: Devices, display: RunLines, wishes: Wishes, *, anew: bool) -> Result:
        """Measure what is still missing on a prepared cell, and return the result."""


class Job(DeviceJob[Result]):
    """What is measured in one stage of a campaign, and what is made of its series."""

    def __init__(
        self, campaign: Campaign, work: Work, preview: RunPreview, retry: int | None
    ) -> None:
        """`retry` is that of `DeviceJob`."""
        super().__init__(campaign, work.stage, retry)
        self.work, self.preview = work, preview

    @override
    def measure(self, cell: Devices, display: RunLines, wishes: Wishes, *, anew: bool) -> Result:
        work = self.prepare(cell)
        with self.campaign.opened_journal() as journal:
            series = measure_series(cell, journal, work, display, wishes, anew=anew)
            return self.finish(journal, series)

    def brief(self, devices: DeviceIdentities) -> str:
        """Say what will be measured with these devices, before the operator is asked."""
        return briefing(self.campaign, self.work, self.preview, devices)

    def prepare(self, cell: Devices) -> Work:  # noqa: ARG002 - a plan asks nothing of the devices
        """Return the work, once the cell is connected."""
        return self.work

    @abstractmethod
    def finish(self, journal: Journal, series: int) -> Result:
        """Return the result of the measured series, the journal still held."""


class Clearance:
    """Operator's consent that the robot moves, given by --yes or asked for.

    The question names the devices that answer; these devices must answer afterwards, too.
    """

    def __init__(self, job: DeviceJob[Result], terminal: Terminal, *, yes: bool) -> None:
        """`yes`: whether the option --yes gives the consent."""
        self.is_given = yes
        self._job = job
        self._terminal = terminal
        self._devices: DeviceIdentities | None = None

    def ask(self) -> None:
        """Connect and ask, unless --yes was given; raise `NotConfirmed` for a no. Nothing moves."""
        if self.is_given:
            return
        self._terminal.require_somebody()
        with connected_cell(self._job.campaign) as cell:
            self._devices = identities(cell)
        question = f"{self._job.brief(self._devices)}. Is the cell clear?"
        self._terminal.require_yes(question, yes=False)

    def check(self, devices: DeviceIdentities) -> None:
        """Raise `WrongDevice` for other devices than before; name the first ones."""
        if self._devices is None:  # with --yes nothing was asked: the operator reads it here
            self._devices = devices
            self._terminal.note(self._job.brief(devices))
        if devices != self._devices:
            raise WrongDevice(
                f"{serials(devices)} answer now, before the question it was "
                f"{serials(self._devices)}",
                remedy="check the addresses, then start again",
            )


def measure(
    job: DeviceJob[Result],
    terminal: Terminal,
    *,
    yes: bool,
    anew: bool = False,
    plain: bool = False,
) -> Result:
    """Measure a job and return its result; connect again after errors that may be over soon.

    `yes`: the cell is clear, and there may be no one to help. `anew`: begin a new series although
    one is unfinished. `plain`: print progress by lines, and read no keys.
    Raise `Interrupted` when the operator stopped and does not want to go on now.
    """
    campaign, clearance = job.campaign, Clearance(job, terminal, yes=yes)
    retries = Retries(campaign, job.retry, pause_clock(campaign))
    with campaign.held():
        campaign.require_devices()
        clearance.ask()
        series_before = _latest_series(campaign)
        while True:
            # The option asks for one new series: a second try resumes what the first has begun.
            is_new = anew and _latest_series(campaign) == series_before
            stop = StopRequest()
            try:
                # the wait for the next try is stopped by signals, too; the question below is not:
                # there Ctrl-C means no
                with stop_on_signals(stop):
                    try:
                        return _measure_once(
                            job, terminal, clearance, stop, anew=is_new, plain=plain
                        )
                    except (Interrupted, Cancelled):
                        raise
                    except (DriverError, CampaignError) as error:
                        _wait_for_next_try(error, retries, terminal, stop)
            except (Interrupted, Cancelled) as stopped:
                # going on is a new turn of the loop: connect again, resume by the journal
                if not (stop.may_go_on and _wants_to_resume(stop, terminal)):
                    raise Interrupted(
                        f"{job.title}: stopped by the operator; everything measured is kept",
                        remedy="type the same command again to resume it",
                    ) from stopped


def _measure_once(
    job: DeviceJob[Result],
    terminal: Terminal,
    clearance: Clearance,
    stop: StopRequest,
    *,
    anew: bool,
    plain: bool,
) -> Result:
    """Connect, measure what the series lacks, and finish the job."""
    campaign, wishes = job.campaign, Wishes(stop)
    by_hand = campaign.is_by_hand
    with terminal.watching(job.title, plain=plain or by_hand, shot_by_shot=by_hand) as display:
        prompt = _with_step_back(terminal.prompt(display, stop), wishes)
        with (
            _keys(display, stop, wishes),
            connected_cell(campaign, stop, terminal.alarm, prompt, display.announce) as cell,
        ):
            devices = identities(cell)
            for name, identity in zip(("controller", "tracker"), devices, strict=True):
                terminal.detail(f"{name}: {identity}")
            clearance.check(devices)
            prepare(campaign, cell)
            if prompt is not None:
                cell = _with_operator(cell, prompt, waits_for_beam=not clearance.is_given)
            return job.measure(cell, display, wishes, anew=anew)


def _with_step_back(prompt: Prompt | None, wishes: Wishes) -> Prompt | None:
    """Return a prompt whose answer `u` also asks for the last shot again; None without one."""
    if prompt is None:
        return None

    def ask(question: str) -> str:
        typed = prompt(question)
        if typed.strip() == BACK:
            wishes.ask(Wish.BACK)
        return typed

    return ask


def _with_operator(cell: Devices, prompt: Prompt, *, waits_for_beam: bool) -> Devices:
    """Return the cell with an operator who answers questions and can restore a broken beam."""
    # With --yes there may be no one in the hall: then the wait for a broken beam has an end.
    wait_s = math.inf if waits_for_beam else cell.beam_wait_s
    return replace(
        cell,
        ask=lambda question: is_yes(prompt(f"{question} [y/N] ")),
        beam_wait_s=wait_s,
        instrument=cell.instrument or read_by_hand(prompt),
    )


@contextmanager
def _keys(display: RunLines, stop: StopRequest, wishes: Wishes) -> Iterator[None]:
    """Turn keys into wishes while the screen names them; q stops at once, as Ctrl-C does."""

    def pressed(key: str) -> None:
        display.answer(key)
        if key == STOP_KEY:
            stop.ask(signal.SIGINT)
        elif key in WISH_OF_KEY:
            wishes.ask(WISH_OF_KEY[key])

    if not display.has_screen:
        yield
        return
    with KEYBOARD.keys(pressed):
        yield


def _wait_for_next_try(
    error: ExplainedError, retries: Retries, terminal: Terminal, stop: StopRequest
) -> None:
    """Wait for the next try; raise the error if no try is left, `Interrupted` when stopped."""
    pause_s = retries.again_after(error)
    if pause_s is None:
        raise error
    terminal.note(f"! {retries.text(error)}", WARNING)
    retries.wait(pause_s, stop)


def _latest_series(campaign: Campaign) -> int:
    """Return the number of the series that was begun last, of any stage; 0 without one."""
    if not campaign.journal_path.exists():
        return 0
    with campaign.journal_reader() as journal:
        return max((series.number for series in journal.series()), default=0)


def identities(cell: Devices) -> DeviceIdentities:
    """Ask both devices of a connected cell who they are."""
    return cell.robot.identity(), cell.tracker.identity()


def wants_to_go_on(stop: StopRequest, terminal: Terminal) -> bool:
    """Ask the operator whether to go on, after Ctrl-Z once the process is continued."""
    # Ctrl-Z suspends only now, when the robot stands: a suspended process could not stop it.
    terminal.note("stopped: the robot stands still, everything measured is kept", WARNING)
    if stop.suspends:
        suspend()
        terminal.note("continued: the robot still stands where it was stopped", WARNING)
    return terminal.asks("Go on where it was?")


def _wants_to_resume(stop: StopRequest, terminal: Terminal) -> bool:
    """Ask the operator; signals are not caught here, so Ctrl-C means no."""
    try:
        return wants_to_go_on(stop, terminal)
    except KeyboardInterrupt:
        return False


class RunJob(Job[RunResult]):
    """Run of the plan."""

    def finish(self, journal: Journal, series: int) -> RunResult:
        """Return what the journal has of the plan."""
        return run_result(journal, series, self.work)


class ObservationJob(DeviceJob[ObservationResult]):
    """Observations that are planned in observations.csv."""

    def __init__(self, campaign: Campaign, planned: int, retry: int | None) -> None:
        """`planned`: number of observations that are not measured yet."""
        super().__init__(campaign, "observations", retry)
        self._planned = planned

    @override
    def brief(self, devices: DeviceIdentities) -> str:
        speed = self.campaign.config.controller.speed_percent
        return f"{self._planned} observations, {speed:g} % speed, {serials(devices)}"

    @override
    def measure(
        self, cell: Devices, display: RunLines, wishes: Wishes, *, anew: bool
    ) -> ObservationResult:
        # Values that a killed process has left in the journal alone are written into the file, and
        # what is planned is read again: an earlier try may have measured some of it.
        with self.campaign.opened_journal() as journal:
            fill_in(self.campaign, journal)
            work = observation_work(self.campaign, journal, planned_observations(self.campaign))
            result = Observing(cell, work, display, wishes).run()
            journal.prove()
            return result


class ValidationJob(Job[validation.Validated]):
    """Measurement of how accurate the robot is, evaluated and judged."""

    def __init__(
        self,
        campaign: Campaign,
        terminal: Terminal,
        options: ValidationOptions,
        held: Mapping[str, float],
        objections: Sequence[OptionsInvalid] = (),
        *,
        anew: bool = False,
    ) -> None:
        """`held`: the controller's parameters; `objections`: refusals that were overridden."""
        work, _ = validation.validation_work(campaign, held, options)
        preview = run_preview(campaign, validation.seconds_of(campaign, work), work, anew=anew)
        super().__init__(campaign, work, preview, options.retry)
        self.title = f"validate {options.stage}"
        self._terminal, self._options = terminal, options
        self._unrecorded = [*objections]

    def brief(self, devices: DeviceIdentities) -> str:
        """Say which stage is measured, and with how many shots."""
        return f"Validation '{self._options.stage}': {super().brief(devices)}"

    def prepare(self, cell: Devices) -> Work:
        """Record the objections once, and make the work for the parameters held now."""
        # Every try calls this function: only the first has objections to record. The parameters
        # are read again, because somebody may have loaded others since the preview was made.
        with self.campaign.opened_journal() as journal:
            validation.record_objections(journal, self._unrecorded)
        self._unrecorded.clear()
        held = cell.robot.read_geometry()
        work, notes = validation.validation_work(self.campaign, held, self._options)
        for note in notes:
            self._terminal.note(f"! {note}", WARNING)
        return work

    def finish(self, journal: Journal, series: int) -> validation.Validated:
        """Evaluate and judge the series."""
        stage, by = self._options.stage, self._options.by
        return validation.record_validation(self.campaign, journal, series, stage, by)


def find_measured(campaign: Campaign, work: Work, terminal: Terminal) -> RunResult | None:
    """Return the earlier result of a plan of which nothing is left to measure, and say so."""
    ran = measured_before(campaign, work)
    if ran is not None:
        more = (
            "a run without --until takes the rest"
            if ran.left_out
            else "--anew takes all of it again"
        )
        terminal.note(f"all of the plan is measured; {more}")
    return ran


def run_plan(campaign: Campaign, checked: CheckedPlan, terminal: Terminal) -> RunResult:
    """Measure all of the plan that is missing."""
    work = run_work(campaign, checked, RunOptions())
    measured = find_measured(campaign, work, terminal)
    if measured is not None:
        return measured
    preview = run_preview(campaign, checked.seconds, work)
    return measure(RunJob(campaign, work, preview, None), terminal, yes=True, plain=True)
