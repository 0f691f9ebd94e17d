"""Runs that are stopped, killed, or met by another process: nothing is lost, nothing done twice."""

import contextlib
import os
import pty
import re
import select
import signal
import socket
import time
from collections import Counter

import psutil
import pytest
from command_line import change, ended, started

from campaigns.errors import JournalFailed
from campaigns.journal.journal import read_journal
from campaigns.journal.records import Event, Finding, Intent, Outcome, SessionStopped

SLOW = {"speed_up": 30}
FAST = {"speed_up": 1000}
WATCHED = {"speed_up": 8}
"""So slow that a picture drawn four times a second, late on a busy machine, shows every state."""
AT_WORK_SHOTS = 4
DEVICES = "50 % speed, controller SIM-C-0001, tracker 390001"
RESUMED = re.compile(rf"series 1 has (\d+) of 33 shots, (\d+) are left, about .*, {DEVICES}")
PATIENCE_S = 60.0
ESCAPES = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


def wait_until(condition, process):
    """Wait for something that another process does."""
    give_up = time.monotonic() + PATIENCE_S
    while not condition():
        assert process.poll() is None, process.communicate()
        assert time.monotonic() < give_up, "nothing happened"
        time.sleep(0.01)


def is_at_work(folder):
    """Whether some shots are measured and the next one is on its way."""
    with contextlib.suppress(JournalFailed), read_journal(folder / "campaign.db") as journal:
        return len(journal.records_of(Outcome)) >= AT_WORK_SHOTS
    return False


@pytest.fixture
def at_work(planned):
    """A run in a process of its own, with the robot moving."""
    change(planned / "cell.yaml", SLOW)
    process = started("run", planned, "--yes", process_group=0)
    try:
        wait_until(lambda: is_at_work(planned), process)
        yield process
    finally:
        process.kill()
        process.communicate()


def assert_resumes(pkmcal, folder):
    """A second run completes the first; no number is given twice and the drift is compared."""
    change(folder / "cell.yaml", FAST)
    resumed = pkmcal("run", folder, "--yes", "--json")
    assert resumed.code == 0, resumed.err
    assert (resumed.document["series"], resumed.document["shots"]) == (1, 33)
    measured, missing = map(int, RESUMED.search(resumed.err).groups())
    assert measured >= AT_WORK_SHOTS - 1, "but for half a pair"
    assert measured + missing == 33
    with read_journal(folder / "campaign.db") as journal:
        tries = Counter((e.record.shot, e.record.attempt) for e in journal.records_of(Intent, 1))
        assert set(tries.values()) == {1}
        records = [entry.record for entry in journal.records(1)]
    kinds = [r.kind if isinstance(r, Event) else type(r).__name__ for r in records]
    resumed_at = kinds.index("resumed")
    assert "drift check" in kinds[resumed_at : kinds.index("Outcome", resumed_at)], "first of all"


def test_a_campaign_belongs_to_one_process_until_ctrl_c_stops_the_robot_in_order(
    at_work, planned, pkmcal
):
    for command in (["run", planned, "--yes"], ["plan", planned, "--force"], ["identify", planned]):
        refused = pkmcal(*command)
        assert refused.code == 2
        assert f"process {at_work.pid}" in refused.error_line
    assert at_work.poll() is None, "the one at work was not disturbed"
    for _ in range(5):
        at_work.send_signal(signal.SIGINT)
        time.sleep(0.0005)
    stopped = ended(at_work)
    assert stopped.code == 130
    assert "type the same command again to resume it" in stopped.error_line
    with read_journal(planned / "campaign.db") as journal:
        assert [e.record.how for e in journal.records_of(SessionStopped)] == ["interrupted"]
        assert not sum(series.unstopped for series in journal.series())
    assert_resumes(pkmcal, planned)


def is_waiting(process):
    """Whether it waits, as for an answer: one that comes while the question is written is early."""
    return psutil.Process(process.pid).status() == psutil.STATUS_SLEEPING


def is_suspended(process):
    return psutil.Process(process.pid).status() == psutil.STATUS_STOPPED


class Screen:
    """The operator's end of a pseudo-terminal."""

    def __init__(self, controlling_end):
        self._end = controlling_end
        self._written = ""

    @property
    def shown(self):
        """Words that were written, whatever their places, colours and lines."""
        return " ".join(ESCAPES.sub(" ", self._written).split())

    def read_until(self, text):
        give_up = time.monotonic() + PATIENCE_S
        while text not in self.shown:
            assert time.monotonic() < give_up, self.shown
            if select.select([self._end], [], [], 0.1)[0]:
                try:
                    self._written += os.read(self._end, 65536).decode(errors="replace")
                except OSError:  # the other end is closed
                    assert text in self.shown, f"it ended without: {text}"

    def read_for(self, seconds):
        give_up = time.monotonic() + seconds
        while (left := give_up - time.monotonic()) > 0:
            if select.select([self._end], [], [], left)[0]:
                self._written += os.read(self._end, 65536).decode(errors="replace")

    def type(self, text):
        self._written = ""
        os.write(self._end, text.encode())


@contextlib.contextmanager
def on_a_screen(*arguments, typed=b"", in_foreground=False):
    """A program on a terminal of its own, and the operator's end of it."""
    operator_end, program_end = pty.openpty()
    os.write(operator_end, typed)
    # in the foreground its keys are heard; else its group is its own, for nobody could continue it
    group = {"preexec_fn": lambda: os.login_tty(0)} if in_foreground else {"process_group": 0}
    process = started(
        *arguments,
        stdin=program_end,
        stderr=program_end,
        env={**os.environ, "TERM": "xterm", "COLUMNS": "100", "LINES": "30"},
        **group,
    )
    os.close(program_end)
    try:
        yield Screen(operator_end), process
    finally:
        process.kill()
        process.communicate()
        os.close(operator_end)


def test_keys_pause_measure_again_park_and_stop(planned):
    change(planned / "cell.yaml", SLOW)
    with on_a_screen("run", planned, "--yes", in_foreground=True) as (screen, process):
        screen.read_until("of 33 shots")
        screen.read_until("residual")
        screen.type("p")
        screen.read_until("paused by the operator")
        screen.type("p")
        screen.read_until("resumed by the operator")
        screen.type("r")
        screen.read_until("again (operator)")
        screen.type("k")
        screen.read_until("parked by the operator")
        screen.type("q")
        screen.read_until("Go on where it was? [y/N]")
        screen.type("y\n")
        screen.read_until("residual")
        process.send_signal(signal.SIGINT)
        screen.read_until("Go on where it was? [y/N]")
        process.send_signal(signal.SIGINT)  # at the question it means no
        screen.read_until("to resume it")
        assert process.wait(PATIENCE_S) == 130
    with read_journal(planned / "campaign.db") as journal:
        events = [entry.record for entry in journal.records_of(Event)]
        notes = [event.text for event in events if event.kind == "operator note"]
        endings = [e.record.how for e in journal.records_of(SessionStopped)]
    assert endings == ["interrupted", "interrupted"], "told to go on once"
    assert [text.split()[0] for text in notes] == ["paused", "resumed", "measuring", "parked"]


@pytest.mark.long
def test_after_ctrl_z_the_operator_is_asked_before_it_goes_on(planned):
    change(planned / "cell.yaml", WATCHED)
    typed_before_there_is_a_question = b"y\n" * 10
    with on_a_screen("run", planned, typed=typed_before_there_is_a_question) as (screen, process):
        screen.read_until("Is the cell clear? [y/N]")
        screen.read_for(0.3)
        assert "run" not in screen.shown.partition("[y/N]")[2], "typed before, it is no answer"
        screen.type("y\n")
        screen.read_until("left")
        change(planned / "cell.yaml", FAST)
        process.send_signal(signal.SIGTSTP)
        screen.read_until("the robot stands still")
        wait_until(lambda: is_suspended(process), process)
        assert "Go on" not in screen.shown
        screen.type("y\n")
        process.send_signal(signal.SIGCONT)
        screen.read_until("Go on where it was? [y/N]")
        assert process.poll() is None, "what was typed meanwhile is no answer"
        screen.type("y\n")
        screen.read_until("33 of 33 shots")
        screen.read_until("pkmcal identify")
        assert process.wait(PATIENCE_S) == 0


@pytest.fixture
def screen_and_load(exported):
    """A load that verifies, on a terminal of its own, measuring with the new parameters."""
    change(exported / "cell.yaml", WATCHED)
    with on_a_screen("load", exported, "--verify", "3", "--yes") as (screen, process):
        wait_until(lambda: has_begun(exported, "verify after"), process)
        yield screen, process


def has_begun(folder, stage):
    with contextlib.suppress(JournalFailed), read_journal(folder / "campaign.db") as journal:
        latest = journal.latest_series(stage)
        return latest is not None and bool(journal.records_of(Outcome, latest.number))
    return False


def loads(folder):
    with read_journal(folder / "campaign.db") as journal:
        kinds = [e.record.kind for e in journal.records_of(Finding)]
    return [kind for kind in kinds if kind.startswith("load")]


def suspended_and_asked(screen, process):
    """Suspend the load by Ctrl-Z, and continue it as far as the question."""
    process.send_signal(signal.SIGTSTP)
    screen.read_until("the robot stands still")
    wait_until(lambda: is_suspended(process), process)
    process.send_signal(signal.SIGCONT)
    screen.read_until("Go on where it was? [y/N]")


@pytest.mark.long
def test_a_suspended_load_is_verified_once_the_operator_says_so(screen_and_load, exported):
    screen, process = screen_and_load
    suspended_and_asked(screen, process)
    assert loads(exported) == ["load begun"]
    screen.type("y\n")
    screen.read_until("6 of 6 shots")  # not each is drawn
    out, _ = process.communicate(timeout=PATIENCE_S)
    assert (process.returncode, "loaded and verified" in out) == (0, True)
    assert loads(exported) == ["load begun", "load"]
    with read_journal(exported / "campaign.db") as journal:
        latest = journal.latest_series("verify after")
        endings = [e.record.how for e in journal.records_of(SessionStopped, latest.number)]
        assert endings == ["interrupted", "finished"]
        assert len(journal.shots(latest.number)) == 6


@pytest.mark.long
@pytest.mark.parametrize("answer", [signal.SIGINT, signal.SIGHUP])
def test_a_suspended_load_that_does_not_go_on_is_taken_back(screen_and_load, exported, answer):
    screen, process = screen_and_load
    suspended_and_asked(screen, process)
    wait_until(lambda: is_waiting(process), process)
    process.send_signal(answer)
    screen.read_until("rolled back")
    assert process.wait(PATIENCE_S) == 130
    assert loads(exported) == ["load begun", "load failed"]


@pytest.mark.long
def test_a_load_that_hears_nothing_says_that_it_was_interrupted(exported):
    with socket.create_server(("127.0.0.1", 0)) as silent:
        url = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        change(exported / "campaign.yaml", {"controller.url": url})
        process = started("load", exported, "--yes")
        connection, _ = silent.accept()
        with connection:
            process.send_signal(signal.SIGINT)
            done = ended(process)
    assert done.code == 130
    assert done.error_line == "interrupted → start the command again when ready"
