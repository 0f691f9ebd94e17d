"""Runs killed at every record of the journal, and at random moments: nothing lost, nothing doubled.

python -m benchmarks.torture.kills [--kills N] [--every N] [--seed N] [--json]

A plan of 12 pairs with drift shots, on devices that take no time, and a real journal on the disk
of temporary files (TMPDIR). Each run is a process of its own that gets SIGKILL: once after every
single record that a whole run writes (or every Nth), then N times at random moments, a campaign as
often as it takes until it is complete. The process says of each record that it is durable, over a
pipe, before it goes on.
After every kill the journal is opened and checked: all that was said to be durable has to be in it,
byte for byte. In the end each shot has one accepted outcome, with the point that the tracker gave,
no attempt was made twice, and the journal proves whole.
"""

import os
import signal
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import cast

import numpy as np

from benchmarks.engine import AIR, COVARIANCE_MM2, DEVICE, InstantRobot, work_of
from benchmarks.shared.prototype import CENTRE, EVERYWHERE, NOMINAL, ROBOT
from benchmarks.shared.yardstick import Figure, Report, main
from campaigns.campaign import now_utc
from campaigns.journal.database import (
    connect_to_read,
    connect_to_write,
    stored_records,
    verify_file,
)
from campaigns.journal.journal import Journal, read_journal
from campaigns.journal.records import Intent, Outcome, Record
from campaigns.measuring.resume import complete_series
from campaigns.measuring.run_state import SILENT
from campaigns.measuring.session import measure_series
from campaigns.measuring.work import Cell
from campaigns.planning.plan_file import PlannedShot
from campaigns.planning.plans import PlanRequest, make_plan
from drivers.ports import LaserTracker, RobotController
from drivers.values import Identity, Measurement, Vector3, Weather, vector
from sim.clock import ManualClock

PAIRS, DRIFT_SHOTS = 12, 3
TRACKER_FROM_BASE_MM = np.array([2500.0, 400.0, 300.0])
LONGEST_RUN_S = 120.0
STRANGER = 3
"""Exit code of a run that ended by itself with an error."""


@dataclass
class Tally:
    """What was found over all runs."""

    kills: int = 0
    lost: int = 0
    doubled: int = 0
    wrong: int = 0
    campaigns: int = 0
    completed: int = 0
    records: list[int] = field(default_factory=list)
    """Durable at each kill."""


@dataclass
class SteadyTracker:
    """Sees the point of the nominal robot at the joints that it has."""

    robot: InstantRobot

    def identity(self) -> Identity:
        return DEVICE

    def weather(self) -> Weather:
        return AIR

    def direction(self) -> None:
        """Nobody asks where it looks: its beam never breaks."""

    def measure(self) -> Measurement:
        return Measurement(point_mm(self.robot.joints), COVARIANCE_MM2, AIR, "instant")


def point_mm(joints: Sequence[float]) -> Vector3:
    """Point that the tracker sees of a robot at these joints."""
    pose = NOMINAL.forward(np.array([joints])).values_or_raise()[0]
    return vector(pose[:3] + TRACKER_FROM_BASE_MM)


class TellingJournal(Journal):
    """Says of each record that it is durable, and can die right after the nth."""

    def __init__(self, path: Path, tell_to: int, dies_after: int | None) -> None:
        super().__init__(connect_to_write(path, create=not path.exists()), path, now_utc)
        self._tell_to = tell_to
        self._dies_after = dies_after
        self._written = 0

    def append(self, record: Record, *, series: int | None = None) -> int:
        place = super().append(record, series=series)
        os.write(self._tell_to, f"{place} {self.end().digest}\n".encode())
        self._written += 1
        if self._written == self._dies_after:
            os.kill(os.getpid(), signal.SIGKILL)
        return place


def measure(kills: int, every: int, seed: int) -> Report:
    rng = np.random.default_rng(seed)
    shots = make_plan(
        ROBOT, EVERYWHERE, PlanRequest(2 * PAIRS, 0, DRIFT_SHOTS, CENTRE), np.random.default_rng(1)
    )
    boundaries, random = Tally(), Tally()
    with tempfile.TemporaryDirectory() as folder:
        names = (Path(folder) / f"{number}" for number in count())
        longest_s, records = whole_run(next(names), shots, boundaries)
        for place in range(1, records + 1, every):
            campaign = next(names)
            killed(campaign, shots, boundaries, dies_after=place)
            finished(campaign, shots, boundaries)
        while random.kills < kills:
            killed_until_complete(next(names), shots, random, kills, longest_s, rng)
    return Report([*figures("at a record", boundaries), *figures("at random", random)])


def figures(where: str, found: Tally) -> list[Figure]:
    """What was found, with what must be."""
    return [
        Figure(f"kills {where}", found.kills),
        Figure(f"records lost, kills {where}", found.lost, highest=0),
        Figure(f"attempts or shots doubled, kills {where}", found.doubled, highest=0),
        Figure(f"points stored wrong, kills {where}", found.wrong, highest=0),
        Figure(f"campaigns completed, kills {where}", found.completed, lowest=found.campaigns),
        Figure(f"campaigns, kills {where}", found.campaigns),
        Figure(f"records at the kill, median {where}", float(np.median(found.records or [0]))),
    ]


def whole_run(folder: Path, shots: Sequence[PlannedShot], found: Tally) -> tuple[float, int]:
    """Undisturbed run; gives the seconds it takes, and its records."""
    began_s = time.perf_counter()
    finished(folder, shots, found)
    seconds = time.perf_counter() - began_s
    with read_journal(folder / "campaign.db") as journal:
        return seconds, journal.last_number()


def killed_until_complete(
    folder: Path,
    shots: Sequence[PlannedShot],
    found: Tally,
    kills: int,
    longest_s: float,
    rng: np.random.Generator,
) -> None:
    """Kill at random moments, until one comes too late or the kills are used up."""
    while found.kills < kills:
        if killed(folder, shots, found, after_s=float(rng.uniform(0.0, longest_s))):
            break
    finished(folder, shots, found)


def finished(folder: Path, shots: Sequence[PlannedShot], found: Tally) -> None:
    """Let a campaign come to its end, and look at all of it."""
    killed(folder, shots, found)
    found.campaigns += 1
    check_whole(folder / "campaign.db", shots, found)


def killed(
    folder: Path,
    shots: Sequence[PlannedShot],
    found: Tally,
    *,
    dies_after: int | None = None,
    after_s: float | None = None,
) -> bool:
    """Run in a process that is killed, or not; gives whether it came to its end.

    Whatever it said to be durable has to be in the journal afterwards.
    """
    folder.mkdir(exist_ok=True)
    said_by, tell_to = os.pipe()
    process = os.fork()
    if process == 0:
        os._exit(run_in_child(lambda: run(folder, shots, tell_to, dies_after)))
    os.close(tell_to)
    if after_s is not None:
        time.sleep(after_s)
        os.kill(process, signal.SIGKILL)
    with os.fdopen(said_by) as said:
        durable = [line.split() for line in said.read().splitlines()]
    _, status = os.waitpid(process, 0)
    if os.WIFEXITED(status) and os.WEXITSTATUS(status):
        raise SystemExit(f"a run ended by itself with exit code {os.WEXITSTATUS(status)}")
    was_killed = os.WIFSIGNALED(status)
    found.kills += was_killed
    if was_killed:
        found.records.append(len(durable))
    check_durable(folder / "campaign.db", durable, found)
    return not was_killed


def run_in_child(work: Callable[[], None]) -> int:
    """Exit code of a process that must not go on with what its parent does."""
    signal.alarm(int(LONGEST_RUN_S))
    try:
        work()
    except BaseException as error:  # noqa: BLE001 - nothing may escape into the parent's code
        os.write(2, f"{type(error).__name__}: {error}\n".encode())
        return STRANGER
    return 0


def run(folder: Path, shots: Sequence[PlannedShot], tell_to: int, dies_after: int | None) -> None:
    """Measure what the plan still lacks, on devices that take no time."""
    clock, robot = ManualClock(), InstantRobot(shots[0].joints)
    # they know only what a run asks of them
    devices = cast(RobotController, robot), cast(LaserTracker, SteadyTracker(robot))
    work = work_of(shots)
    with TellingJournal(folder / "campaign.db", tell_to, dies_after) as journal:
        if complete_series(journal, work) is None:
            measure_series(Cell(*devices, clock, clock), journal, work, SILENT, lambda: False)


def check_durable(path: Path, durable: Sequence[Sequence[str]], found: Tally) -> None:
    """Count what was said to be durable and is not in the journal, or not as it was written."""
    if not durable:
        return  # killed before there was a journal, perhaps
    with closing(connect_to_read(path)) as connection:
        rows, _ = stored_records(connection)
    stored = {row[0]: row[-1] for row in rows}
    found.lost += sum(stored.get(int(number)) != digest for number, digest in durable)


def check_whole(path: Path, shots: Sequence[PlannedShot], found: Tally) -> None:
    """Count doubled attempts and shots, wrong points, and whether the campaign is complete."""
    with closing(connect_to_read(path)) as connection:
        verify_file(connection, path)
    with read_journal(path) as journal:
        accepted = journal.shots(1)
        attempts = Counter((e.record.shot, e.record.attempt) for e in journal.records_of(Intent))
        outcomes = [entry.record for entry in journal.records_of(Outcome)]
        series = journal.series()
    found.doubled += sum(times - 1 for times in attempts.values())
    ends = Counter((outcome.shot, outcome.attempt) for outcome in outcomes)
    found.doubled += sum(times - 1 for times in ends.values()) + len(series) - 1
    found.wrong += sum(
        outcome.point_in_tracker_mm != point_mm(outcome.joints) for outcome in outcomes
    )
    wanted = [shot.shot for shot in shots]
    complete = series[0].finished and [shot.intent.shot for shot in accepted] == sorted(wanted)
    found.completed += complete


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure, kills=200, every=1, seed=1))
