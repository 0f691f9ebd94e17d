"""Runs that are killed: nothing durable is lost, nothing done twice, each comes to its end.

Twelve pairs with drift shots on devices that take no time, and a real journal. Each run is a
process of its own that gets SIGKILL right after a record, or at a random moment, and says over a
pipe of each record that it is durable before it goes on. In CI and with `--times` after every
record, else after each fourth; twelve times as many random kills as `--times` says.
"""

import os
import signal
import time
from collections import Counter
from dataclasses import dataclass
from itertools import count

import numpy as np
import pytest
from fake_cell import AIR, COVARIANCE_MM2, NOMINAL, ROBOT
from small_plans import work
from timed_pipe import HandClock

from campaigns.campaign import now_utc
from campaigns.journal.journal import Journal, read_journal
from campaigns.journal.records import Intent, Outcome
from campaigns.measuring.resume import complete_series
from campaigns.measuring.run_state import SILENT, Wishes
from campaigns.measuring.session import measure_series
from campaigns.measuring.work import Cell
from campaigns.planning.plans import PlanRequest, View, make_plan
from campaigns.settings.sections import SettleConfig
from drivers.values import Identity, Measurement, Pose, RobotState, vector

pytestmark = [pytest.mark.torture, pytest.mark.long, pytest.mark.timeout(600)]

PAIRS, DRIFT_SHOTS = 12, 3
KILLS = 12
EVERYWHERE = View((2500.0, 0.0, -575.0), (1.0, 0.0, 0.0), np.pi)
"""The reflector is seen from everywhere."""
TRACKER_FROM_BASE_MM = np.array([2500.0, 400.0, 300.0])
LONGEST_RUN_S = 120
DEVICE = Identity("none", "instant device", "0", "0", "none")
AT_ONCE = SettleConfig.model_construct(
    time_s=0.0, still_deg=5e-4, in_place_deg=5e-3, timeout_s=10.0
)
STRANGER = 3
"""Exit code of a run that ended by itself with an error."""


def point_mm(joints):
    """Point that the tracker sees of a robot at these joints."""
    pose = NOMINAL.forward(np.array([joints])).values_or_raise()[0]
    return vector(pose[:3] + TRACKER_FROM_BASE_MM)


@dataclass
class InstantRobot:
    """Is at its target at once."""

    joints: tuple[float, ...]

    def identity(self):
        return DEVICE

    def state(self):
        return RobotState(self.joints, moving=False, fault="", emergency_stop=False, raw="instant")

    def move_joints(self, joints, _speed_fraction):
        self.joints = tuple(joints)

    def lacks(self, _names):
        return ()


@dataclass
class SteadyTracker:
    """Sees the point of the nominal robot at the joints that it has; its beam never breaks."""

    robot: InstantRobot

    def identity(self):
        return DEVICE

    def weather(self):
        return AIR

    def direction(self):
        return None

    def measure(self):
        return Measurement(point_mm(self.robot.joints), COVARIANCE_MM2, AIR, "instant")


class TellingJournal(Journal):
    """Says of each record that it is durable, and can die right after the nth."""

    def __init__(self, path, tell_to, dies_after):
        super().__init__(path, now_utc)
        self._tell_to, self._left = tell_to, dies_after

    def append(self, record, *, series=None):
        place = super().append(record, series=series)
        os.write(self._tell_to, f"{place} {self.digest()}\n".encode())
        if self._left is not None:
            self._left -= 1
            if self._left == 0:
                os.kill(os.getpid(), signal.SIGKILL)
        return place


def run(folder, shots, tell_to, dies_after):
    """Measure what the plan still lacks."""
    clock, robot = HandClock(), InstantRobot(shots[0].joints)
    cell = Cell(robot, SteadyTracker(robot), clock, clock)
    with TellingJournal(folder / "campaign.db", tell_to, dies_after) as journal:
        planned = work(shots, settle=AT_ONCE)
        if complete_series(journal, planned) is None:
            measure_series(cell, journal, planned, SILENT, Wishes())


def killed(folder, shots, *, dies_after=None, after_s=None):
    """Run in a process that is killed, or not; gives whether it was.

    Whatever it said to be durable has to be in the journal afterwards.
    """
    folder.mkdir(exist_ok=True)
    said_by, tell_to = os.pipe()
    process = os.fork()
    if process == 0:
        code = STRANGER
        try:
            signal.alarm(LONGEST_RUN_S)
            run(folder, shots, tell_to, dies_after)
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


def finished(folder, shots):
    """Let a campaign come to its end, and look at all of it; gives the number of its records."""
    assert not killed(folder, shots)
    with read_journal(folder / "campaign.db") as journal:
        (series,) = journal.series()
        accepted = [shot.intent.shot for shot in journal.shots(1)]
        for kind in (Intent, Outcome):
            tries = Counter((e.record.shot, e.record.attempt) for e in journal.records_of(kind))
            assert set(tries.values()) == {1}
        for entry in journal.records_of(Outcome):
            assert entry.record.point_in_tracker_mm == point_mm(entry.record.joints)
        assert series.finished
        assert accepted == sorted(shot.shot for shot in shots)
        return journal.last_number()


@pytest.fixture(scope="module")
def shots():
    request = PlanRequest(2 * PAIRS, 0, DRIFT_SHOTS, Pose(0.0, 0.0, -575.0, 0.0))
    return make_plan(ROBOT, EVERYWHERE, request, np.random.default_rng(1))


def test_run_that_is_killed_after_a_record_is_taken_up_there(shots, tmp_path, times):
    records = finished(tmp_path / "whole", shots)
    every = 1 if times > 1 or os.environ.get("CI") else 4
    for place in range(1, records + 1, every):
        folder = tmp_path / f"{place}"
        assert killed(folder, shots, dies_after=place)
        finished(folder, shots)


def test_run_that_is_killed_again_and_again_comes_to_its_end(shots, tmp_path, times):
    rng, kills, folders = np.random.default_rng(1), 0, (tmp_path / f"{n}" for n in count())
    began_s = time.perf_counter()
    finished(next(folders), shots)
    longest_s = time.perf_counter() - began_s
    while kills < KILLS * times:
        folder = next(folders)
        while kills < KILLS * times and killed(
            folder, shots, after_s=float(rng.uniform(0.0, longest_s))
        ):
            kills += 1
        finished(folder, shots)
