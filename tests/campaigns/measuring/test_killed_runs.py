"""Runs that are killed: nothing durable is lost, nothing done twice, each comes to its end.

Each run is a process of its own that gets SIGKILL right after a record, or at a random moment, and
says over a pipe of each record that it is durable before it goes on. In CI and with `--times` after
every record, else after each fourth; twelve times as many random kills as `--times` says.
"""

import os
import signal
import time
from collections import Counter
from collections.abc import Sequence
from itertools import count
from pathlib import Path

import numpy as np
import pytest
from fake_cell import NOMINAL, TRACKER_FROM_BASE, FakeCell
from small_plans import FOUR_PAIRS, work

from campaigns.campaign import now_utc
from campaigns.journal.journal import Journal, read_journal
from campaigns.journal.records import Intent, Outcome, Record
from campaigns.measuring.resume import complete_series

pytestmark = [pytest.mark.torture, pytest.mark.long, pytest.mark.timeout(600)]

KILLS = 12
LONGEST_RUN_S = 120
FAILED = 3
"""Exit code of a run that ended by itself with an error."""


def point_mm(joints: Sequence[float]) -> np.ndarray:
    """Point that the tracker sees of the robot at these joints."""
    pose = NOMINAL.forward(np.array([joints])).values_or_raise()[:, :3]
    return TRACKER_FROM_BASE.apply(pose)[0]


class TellingJournal(Journal):
    """Says of each record that it is durable, and can die right after the nth."""

    def __init__(self, path: Path, tell_to: int, dies_after: int | None) -> None:
        super().__init__(path, now_utc)
        self._tell_to, self._records_left = tell_to, dies_after

    def append(self, record: Record, *, series: int | None = None) -> int:
        place = super().append(record, series=series)
        os.write(self._tell_to, f"{place} {self.digest()}\n".encode())
        if self._records_left is not None:
            self._records_left -= 1
            if self._records_left == 0:
                os.kill(os.getpid(), signal.SIGKILL)
        return place


def run(folder: Path, tell_to: int, dies_after: int | None) -> None:
    """Measure what the plan still lacks."""
    planned = work(FOUR_PAIRS)
    with TellingJournal(folder / "campaign.db", tell_to, dies_after) as journal:
        if complete_series(journal, planned) is None:
            FakeCell().measure(journal, planned)


def is_killed(folder: Path, *, dies_after: int | None = None, after_s: float | None = None) -> bool:
    """Run in a process that is killed, or not; return whether it was.

    Whatever it said to be durable has to be in the journal afterwards.
    """
    folder.mkdir(exist_ok=True)
    said_by, tell_to = os.pipe()
    process = os.fork()
    if process == 0:
        code = FAILED
        try:
            signal.alarm(LONGEST_RUN_S)
            run(folder, tell_to, dies_after)
            code = 0
        finally:
            os._exit(code)  # nothing may go on with what the parent does
    os.close(tell_to)
    if after_s is not None:
        time.sleep(after_s)
        os.kill(process, signal.SIGKILL)
    with os.fdopen(said_by) as said:
        durable = {int(number): digest for number, digest in map(str.split, said)}
    code = os.waitstatus_to_exitcode(os.waitpid(process, 0)[1])
    assert code in {0, -signal.SIGKILL}
    if durable:
        with read_journal(folder / "campaign.db") as journal:
            assert all(journal.digest(through=place) == durable[place] for place in durable)
    return code != 0


def finish(folder: Path) -> int:
    """Let a campaign come to its end, and check all of it; return the number of its records."""
    assert not is_killed(folder)
    with read_journal(folder / "campaign.db") as journal:
        (series,) = journal.series()
        assert series.finished
        assert [shot.intent.shot for shot in journal.shots(1)] == list(range(len(FOUR_PAIRS)))
        for kind in (Intent, Outcome):
            tries = Counter((e.record.shot, e.record.attempt) for e in journal.records_of(kind))
            assert set(tries.values()) == {1}
        for entry in journal.records_of(Outcome):
            measured_mm = entry.record.point_in_tracker_mm
            np.testing.assert_allclose(measured_mm, point_mm(entry.record.joints), atol=1e-9)
        return journal.last_number()


def test_run_that_is_killed_after_a_record_is_taken_up_there(tmp_path: Path, times: int) -> None:
    records = finish(tmp_path / "whole")
    every = 1 if times > 1 or os.environ.get("CI") else 4
    for place in range(1, records + 1, every):
        folder = tmp_path / f"{place}"
        assert is_killed(folder, dies_after=place)
        finish(folder)


def test_run_that_is_killed_again_and_again_comes_to_its_end(tmp_path: Path, times: int) -> None:
    rng, kills, folders = np.random.default_rng(1), 0, (tmp_path / f"{n}" for n in count())
    began_s = time.perf_counter()
    finish(next(folders))
    longest_s = time.perf_counter() - began_s
    while kills < KILLS * times:
        folder = next(folders)
        while kills < KILLS * times and is_killed(
            folder, after_s=float(rng.uniform(0.0, longest_s))
        ):
            kills += 1
        finish(folder)
