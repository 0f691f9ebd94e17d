"""Faults by the thousand: a seed draws a piece of work and what goes wrong during it.

One process, event time. The cell outlives commands, as a real one does: a kill leaves the robot as
it is, moving or not. Between any two bytes, records or files the wire may fail, the disk be full,
a signal come, the process be killed (its folder is then as it lay on the disk), the wall clock be
set, a second command start; beams break, drives trip, a device lies. `Player.look` says what must
hold after each command. Once the faults end, two commands complete the work.
"""

import contextlib
import errno
import io
import json
import math
import os
import random
import shutil
import signal
import sqlite3
import traceback
from collections import Counter, namedtuple
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from typing import NamedTuple
from unittest.mock import patch

import numpy as np
from command_line import SMALL_TESTS, change

from app.interrupt import interrupted_by_signals
from app.main import run_command
from campaigns.campaign import open_campaign
from campaigns.journal import database
from campaigns.journal.journal import read_journal
from campaigns.kinematics.catalog import PAR4
from campaigns.kinematics.model import Kinematics
from campaigns.planning.paths import RobotModel
from drivers.link import Link
from sim.cell import Cell
from sim.clock import EventClock
from sim.faults import Counted, Fault
from sim.in_process import InProcessCell
from sim.robot.controller import NO_TROUBLE
from sim.scenarios.scenario import load_scenario
from sim.tracker.beam import Target

SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT)
ON_WIRE = ("cut", "lost", "late", "held", "torn", "twice", "again", "flipped", "stale", "foreign")
ON_DISK = ("full before", "full after")
ANYWHERE = ("killed before", "killed after", "signal", "clock set", "second command")
LIES = ("stands", "frozen encoder", "point of before", "zeros", "metres")
STUCK = "a parameter stuck"
FOREIGN = (b"\n", b"HTTP/1.1 400 Bad Request\r\n\r\n", b"\0" * 40, b"<1 STATE OK 0 0 - 0 0 *0000\n")
SCRIPTED = {
    Counted.MEASUREMENT: ("beam_break", "wrong_target"),
    Counted.MOVE: ("emergency_stop", "drive_fault", "stall"),
    Counted.RESULT: ("early", "repeated", "straggling", "other_units"),
}
SECOND = {"status": (), "check-journal": (), "run": ("--yes", "--anew"), "load": ("--yes",)}
DISK_SHARE = 10
"""How much likelier a fault is at a record than at the many bytes of a wire."""
SHORT = dict.fromkeys(("load", "import", "identify", "update"), 5)
"""How much likelier it is in work that passes few bytes and records."""
MOST_TRIES, PATIENCE = 5, 2
"""Commands at most while there are faults, and after them."""

WALL_MM, POLE_MM, POLE_RADIUS_MM, PLATE_MM, MARGIN_MM = 250.0, (-150.0, -150.0), 20.0, 60.0, 5.0
LIMITS = dict.fromkeys(("distance_mean_mm", "distance_max_mm", "rotation_mm", "straightness_mm"), 6)
SETTINGS = {
    "space.keep_out.boxes": [{"x_mm": [WALL_MM, 900.0]}],
    "space.keep_out.cylinders": [{"centre_mm": [*POLE_MM], "radius_mm": POLE_RADIUS_MM}],
    "space.plate_radius_mm": PLATE_MM,
    "space.margin_mm": MARGIN_MM,
    "plan.drift_shots": 2,
    **SMALL_TESTS,
    **{f"acceptance.{name}": limit for name, limit in LIMITS.items()},
}


class Killed(BaseException):
    """The process is gone."""


class World(InProcessCell):
    """A cell that outlives commands, what goes wrong there, and what must not have happened."""

    def __init__(self, folder, rng):
        self.folder, self.rng = folder, rng
        memory = json.loads((folder / "cell-memory.json").read_text(encoding="utf-8"))
        memory.pop("identity", None)  # the campaign's, which is not the cell's own
        cell = Cell(load_scenario(str(folder / "cell.yaml")), memory=memory)
        super().__init__(cell, EventClock(math.inf))
        self.rate = 10 ** -rng.uniform(1.0, 2.5)
        kinds = (*ON_WIRE, *ON_DISK, *ANYWHERE)
        self.kinds = rng.sample(kinds, rng.randint(1, 6))
        self.is_hostile, self.is_killed, self.is_stopped, self.is_second = True, False, False, False
        self.wall_s, self.pipes = 0.0, []
        self.faults, self.broken = Counter(), []
        self.nominal = open_campaign(folder).robot.kinematics
        self.move_truly, self.cell.controller.move_joints = cell.controller.move_joints, self.move

    def drawn(self, *kinds, share=1):
        """The fault that is due here; "" for none. After a kill no line has any effect."""
        if self.is_killed:
            raise Killed
        if not self.is_hostile or self.is_second or self.rng.random() >= self.rate * share:
            return ""
        possible = [kind for kind in (*kinds, *ANYWHERE) if kind in self.kinds]
        if not possible:
            return ""
        self.faults[kind := self.rng.choice(possible)] += 1
        if kind == "killed before":
            self.kill()
        elif kind == "signal":
            self.is_stopped = True
            os.kill(os.getpid(), self.rng.choice(SIGNALS))
        elif kind == "clock set":
            self.wall_s += self.rng.choice([-86400.0, -3.0, 7200.0, 4e8])
        elif kind == "second command":
            self.start_second()
        return kind

    def kill(self):
        self.is_killed = True
        shutil.copytree(self.folder, self.folder.with_suffix(".killed"))
        raise Killed

    def start_second(self):
        """Start another command meanwhile: it may look on, but neither write nor move."""
        name, before = self.rng.choice([*SECOND]), rows(self.folder)
        self.is_second = True
        code, said = ended(name, self.folder, *SECOND[name])
        self.is_second = False
        if code not in ({2, 4} if SECOND[name] else {0, 1, 2}) or rows(self.folder) != before:
            self.broken.append(f"a second command, {name}, ended with {code}: {said[-300:]}")

    def connect(self, device, name):
        if self.is_second:
            self.broken.append(f"a second command connected to the {device}")
        self.pipes.append(FaultyPipe(self, super().connect(device, name)))
        return self.pipes[-1]

    def move(self, target, speed_fraction, now_s):
        """Move, and see that the plate keeps clear by the nominal or the held parameters."""
        start = self.cell.controller.encoders(now_s)
        duration_s = self.move_truly(target, speed_fraction, now_s)
        change = np.array(target) - start
        steps = np.linspace(0.0, 1.0, 2 + int(abs(change).max() / math.radians(2.0)))
        held = Kinematics.of(PAR4, self.cell.controller.geometry())
        clear_mm = [
            clearance_mm(by, start + steps[:, None] * change) for by in (held, self.nominal)
        ]
        if max(clear_mm) < MARGIN_MM - 0.2:
            self.broken.append(f"a move passes the zones at {max(clear_mm):.2f} mm")
        return duration_s

    def lie(self, kind):
        """Let a device lie about where it is until `be_kind`."""
        controller, tracker, self.faults[kind] = self.cell.controller, self.cell.tracker, 1
        state, finish, points = controller.state, tracker.finish_measurement, []
        frozen = state(self.now_s()).joints[1]

        def frozen_state(now_s):
            said = state(now_s)
            return replace(said, joints=(said.joints[0], frozen, *said.joints[2:]))

        def false_point(now_s):
            if (shot := finish(now_s)) is None:
                return None
            points.append(shot.point_in_tracker_mm)
            scale = 1e-3 if kind == "metres" else 0.0
            said = points[0] if kind == "point of before" else [scale * x for x in points[-1]]
            return replace(shot, point_in_tracker_mm=tuple(said))

        if kind == "stands":
            controller.move_joints = lambda target, speed_fraction, now_s: 1.0
        elif kind == "frozen encoder":
            controller.state = frozen_state
        elif kind == STUCK:  # alone, for a kill would leave the mixed set that a load has to undo
            self.rate, replace_truly = 0.0, controller.replace_geometry
            name, value = self.rng.choice(sorted(controller.geometry().items()))
            controller.replace_geometry = lambda wanted, now_s: replace_truly(
                {**wanted, name: value}, now_s
            )
        else:
            tracker.finish_measurement = false_point

    def be_kind(self):
        """End all faults; what is pending at the robot has been acknowledged."""
        self.is_hostile = False
        self.sleep_s(100.0)  # longer than any beam is broken
        self.cell.faults._faults.clear()
        vars(self.cell.controller).pop("state", None)
        vars(self.cell.controller).pop("replace_geometry", None)
        vars(self.cell.tracker).pop("finish_measurement", None)
        self.cell.controller.move_joints = self.move
        self.acknowledge()
        self.cell.tracker.beam.locked_on = Target.ROBOT  # put there by hand

    def acknowledge(self):
        self.cell.controller._trouble = NO_TROUBLE


class FaultyPipe:
    """A pipe to a device, whose bytes are hit on their way."""

    def __init__(self, world, pipe):
        self.world, self.pipe, self.name = world, pipe, pipe.name
        self.later = self.last = b""
        self.held_until_s, self.is_again = 0.0, False

    def send(self, data, timeout_s):
        was_stopped = self.world.is_stopped
        kind = self.world.drawn("cut", "lost")
        if kind == "cut":
            self.pipe.close()
        if kind == "lost":
            return
        if was_stopped and b" MOVE" in data:
            self.world.broken.append(f"a move after a stop: {data!r}")
        self.pipe.send(data, timeout_s)
        if self.later and self.is_again:
            self.world.broken.append(f"asked before what was there was read: {data!r}")
        if kind == "killed after":
            self.world.kill()

    def receive(self, timeout_s):
        held_s = max(0.0, self.held_until_s - self.world.now_s())
        self.world.sleep_s(min(held_s, timeout_s))
        if held_s > timeout_s:
            return b""
        data, self.later = self.later or self.pipe.receive(timeout_s), b""
        if not data:
            return data
        rng, before, self.last = self.world.rng, self.last, data
        kind, at = self.world.drawn(*ON_WIRE), rng.randrange(len(data))
        if kind == "killed after":
            self.world.kill()
        if kind == "cut":
            self.pipe.close()
        if kind == "late":
            self.world.sleep_s(rng.choice([0.3, 3.0, 60.0]))
        if kind == "held":
            self.held_until_s = self.world.now_s() + rng.choice([0.3, 3.0, 60.0])
        self.later = {"torn": data[at:], "held": data, "again": data, "stale": data}.get(kind, b"")
        self.is_again = kind == "again" and timeout_s > 0.0
        changed = bytes([data[at] ^ (1 << rng.randrange(8))])
        hit = {"lost": b"", "held": b"", "cut": data[:at], "torn": data[:at], "twice": data + data}
        hit |= {"flipped": data[:at] + changed + data[at + 1 :], "stale": before}
        return (hit | {"foreign": rng.choice(FOREIGN) + data}).get(kind, data)

    def close(self):
        self.pipe.close()


def watched(ask, world):
    """`Link.ask`, of which each answer is to its question, and which closes after an error."""

    def asked(link, request, **how):
        try:
            answer = ask(link, request, **how)
        except BaseException:
            if link.is_open:
                world.broken.append("a link goes on after an error")
            raise
        number = str(getattr(answer, "number", "")).encode()
        if number not in request:
            world.broken.append(f"{answer} is taken for an answer to {request!r}")
        return answer

    return asked


WAYS = {}
"""Faults of ways by parameters and ends: all stories have the same space and limits."""


def remembered(faults):
    """`RobotModel.faults`, which judges no ways twice: most commands ask for those of before."""

    def faults_of(model, starts, ends):
        key = (*model.kinematics.parameters.items(), starts.tobytes(), ends.tobytes())
        if key not in WAYS:
            WAYS[key] = faults(model, starts, ends)
        return list(WAYS[key])

    return faults_of


def clearance_mm(kinematics, path):
    """Least distance of the plate from wall and pole on a path of joints (n, 4)."""
    solved = kinematics.forward(path)
    x, y = solved.values[solved.is_solved][:, :2].T
    pole_mm = np.hypot(x - POLE_MM[0], y - POLE_MM[1]) - POLE_RADIUS_MM
    return float(min((WALL_MM - x).min(), pole_mm.min()) - PLATE_MM)


def disk_of(world):
    """The functions of the disk, each of which may fail before or after it has done its work."""
    insert, transaction = database.insert, database.transaction
    full, no_space = sqlite3.OperationalError("database or disk is full"), OSError(errno.ENOSPC, "")
    full.sqlite_errorcode = sqlite3.SQLITE_FULL

    def failing(call, error):
        def called(*arguments):
            in_memory = call is insert and not arguments[0].execute(FILE_OF).fetchone()[0]
            kind = "" if in_memory else world.drawn(*ON_DISK, share=DISK_SHARE)
            if kind == "full before":
                raise error
            call(*arguments)
            if kind == "full after":
                raise error
            if kind == "killed after":
                world.kill()

        return called

    @contextlib.contextmanager
    def in_commit(connection, kind):
        with transaction(connection, kind):
            yield
        world.drawn(share=DISK_SHARE if kind == "WRITE" else 0)

    return {
        "campaigns.journal.database.insert": failing(insert, full),
        "campaigns.journal.database.transaction": in_commit,
        "os.fsync": failing(os.fsync, no_space),
        "os.replace": failing(os.replace, no_space),
    }


@contextlib.contextmanager
def hit_by_faults(world):
    """Let commands find this cell, and its faults on disk and clock."""

    @contextlib.contextmanager
    def in_process(campaign, scenario):
        yield world

    class WallClock(datetime):
        @classmethod
        def now(cls, zone):
            passed = timedelta(seconds=world.now_s() + world.wall_s)
            return datetime(2026, 3, 2, 8, tzinfo=UTC) + passed

    patches = disk_of(world) | {
        "app.wiring._in_process": in_process,
        "campaigns.campaign.datetime": WallClock,
        "campaigns.planning.paths.RobotModel.faults": remembered(RobotModel.faults),
        "sys.stdin": io.StringIO(),
        "drivers.link.Link.ask": watched(Link.ask, world),
    }
    with contextlib.ExitStack() as stack:
        for name, what in patches.items():
            stack.enter_context(patch(name, what))
        for number in SIGNALS:  # of which this process may ignore some
            before = signal.signal(number, signal.default_int_handler)
            stack.callback(signal.signal, number, before)
        yield


def ended(*arguments):
    """Run a command; return its exit code and what it said."""
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        try:
            with interrupted_by_signals():
                code = int(run_command([str(argument) for argument in arguments]))
        except KeyboardInterrupt:
            code = 130
    return code, out.getvalue()


Row = namedtuple("Row", "id kind series shot attempt body")
FILE_OF = "SELECT file FROM pragma_database_list"


def rows(folder):
    """All records, past the program's own reader; [] without a journal."""
    if not (folder / "campaign.db").exists():
        return []
    with contextlib.closing(sqlite3.connect(folder / "campaign.db")) as connection:
        stored = connection.execute(f"SELECT {', '.join(Row._fields)} FROM record ORDER BY id")
        return [Row(*row) for row in stored]


def has_open_load(records):
    """Whether the last load of the records was begun and has no end."""
    findings = (json.loads(row.body)["kind"] for row in records if row.kind == "finding")
    return [kind for kind in findings if kind.startswith("load")][-1:] == ["load begun"]


def live_outcomes(records):
    """The outcomes that count, by series and shot; a second one of a shot is an error."""
    live = {}
    for row in records:
        if row.kind == "outcome":
            assert (row.series, row.shot) not in live, f"shot {row.shot} was measured twice"
            live[row.series, row.shot] = json.loads(row.body)
        elif row.kind == "pair-voided":
            for voided in json.loads(row.body)["shots"]:
                live.pop((row.series, voided), None)
    return live


def require_whole(folder, before, after):
    """Raise for a journal that has lost records or breaks its own rules."""
    assert after[: len(before)] == before, "records were lost or changed"
    if after:
        with read_journal(folder / "campaign.db") as journal:  # which verifies all of it
            journal.records()
    begun = Counter(row[2:5] for row in after if row.kind == "intent")
    ends = Counter(row[2:5] for row in after if row.kind in {"outcome", "rejected"})
    assert {*begun.values(), *ends.values()} <= {1}, "an attempt began or ended twice"
    assert {*ends} <= {*begun}, "an attempt ended that had not begun"
    live_outcomes(after)


def wrong_outcomes(taken, live):
    """Yield shots that the tracker never gave of the robot at the joints that were read."""
    for (series, shot), outcome in live.items():
        point = np.array(outcome["point_in_tracker_mm"])
        place = np.degrees(outcome["joints_rad"]) * 1e6
        same = (t for t in taken if abs(point - t.point_in_tracker_mm).max() < 1e-5)
        if not any(t.on == "robot" and abs(place - t.robot_target).max() < 1.5 for t in same):
            yield f"shot {shot} of series {series} is not what was measured there"


class Story(NamedTuple):
    """A piece of work: where it begins, its command, codes of its end, shots it has then."""

    base: str
    words: str
    codes: frozenset[int] = frozenset({0})
    shots: int = 0
    often: int = 1


GOOD_OR_NOT, DONE_BEFORE = frozenset({0, 1}), frozenset({0, 1, 2})
"""What was done, and killed before it could say so, is refused as done already."""
VALIDATE = "validate {folder} --stage before --only rotation --yes --retry {retry}"
LOAD = "load {folder} --robot {folder}/robot-plain.yaml --yes"
STORIES = {
    "run": Story("planned", "run {folder} --yes --retry {retry}", shots=12, often=6),
    "validate": Story("planned", VALIDATE, DONE_BEFORE, shots=3, often=2),
    "check": Story("exported", "check {folder} --yes --retry {retry}", GOOD_OR_NOT, 8, often=2),
    "update": Story("checked", "identify {folder} --update", DONE_BEFORE),
    "identify": Story("exported", "identify {folder}", GOOD_OR_NOT),
    "import": Story("planned", "import {folder} {folder}/shots.csv", DONE_BEFORE, shots=26),
    "load": Story("exported", LOAD, often=4),
    "verify": Story("exported", f"{LOAD} --verify 1", often=3),
}


def make_bases(bases):
    """Make the folders in which stories begin, and one in which the new parameters are loaded."""

    def do(*words):
        code, said = ended(*words)
        assert code == 0, said

    first, planned = bases / "exported", bases / "planned"
    do("new", first, "--scenario", "paper-simulation")
    change(first / "campaign.yaml", SETTINGS | {"plan.shots": 24, "plan.validation_pairs": 1})
    another = {"tracker.other_reflector_mm": [900.0, 350.0, -420.0]}
    change(first / "cell.yaml", {"speed_up": 10_000} | another)
    for words in ("plan", "run --yes", "identify", "export --format plain --force"):
        command, *options = words.split()
        do(command, first, *options)
    lines = ["pair,q0_deg,q1_deg,q2_deg,q3_deg,x_mm,y_mm,z_mm"]
    with open_campaign(first).journal_reader() as journal:
        for shot in journal.shots(1):
            angles = [math.degrees(joint) for joint in shot.outcome.joints]
            row = [shot.intent.pair, *angles, *shot.outcome.point_in_tracker_mm]
            lines += [",".join(map(repr, row))] if row[0] is not None else []
    (first / "shots.csv").write_text("\n".join(lines) + "\n", encoding="utf-8")
    shutil.copytree(first, planned, ignore=shutil.ignore_patterns("campaign.db*", "plan.csv"))
    change(planned / "campaign.yaml", {"plan.shots": 8})
    do("plan", planned)
    do("check", shutil.copytree(first, bases / "checked"), "--yes")
    loaded = shutil.copytree(first, bases / "loaded")
    do("load", loaded, "--robot", loaded / "robot-plain.yaml", "--yes")


class Player:
    """Plays the story of a seed in `scratch`; `broken` is then what must not have happened."""

    def __init__(self, bases, scratch, seed):
        self.rng = rng = random.Random(seed)
        (self.name,) = rng.choices([*STORIES], [story.often for story in STORIES.values()])
        self.story, self.folder = STORIES[self.name], scratch / "story"
        shutil.rmtree(self.folder, ignore_errors=True)
        shutil.copytree(bases / self.story.base, self.folder)
        self.world = World(self.folder, rng)
        self.world.rate *= SHORT.get(self.name, 1)
        memory = json.loads((bases / "loaded" / "cell-memory.json").read_text(encoding="utf-8"))
        self.old, self.new = self.world.cell.controller.geometry(), memory["geometry"]
        self.records = rows(self.folder)
        self.first, self.codes, self.said = len(self.records), [], ""
        self.home = self.world.cell.controller.encoders(0.0)
        self.broken = self.world.broken
        self._script()

    def _script(self):
        """Let beams, drives and results fail by count, or a device lie."""
        rng, script = self.rng, self.world.cell.faults
        for counted, kinds in SCRIPTED.items():
            for _ in range(rng.choice([0, 1, 1, 2])):
                at = script.memory().get(counted, 0) + rng.randint(1, 15)
                lasts_s = rng.choice([1.0, 5.0, 90.0])
                script._faults[counted, at] = Fault(counted, at, rng.choice(kinds), lasts_s)
        if self.name == "run" and rng.random() < 0.2:
            self.world.lie(rng.choice(LIES))
        if self.name == "load" and rng.random() < 0.2:
            self.world.lie(STUCK)

    def play(self):
        """Try among faults, then without; at last take back what was loaded."""
        with hit_by_faults(self.world):
            tries = self.rng.randint(1, MOST_TRIES)
            is_done = any(self._is_done_by_next() or self._passes() for _ in range(tries))
            self.world.be_kind()
            if not is_done and not any(self._is_done_by_next() for _ in range(PATIENCE)):
                self._break("two commands after the faults do not complete it")
            live = self.live()
            self.broken.extend(wrong_outcomes(self.world.cell.tracker.taken, live))
            if self.story.shots and self.story.shots != len(live):
                self._break(f"complete, with {len(live)} shots")
            if self.story.words.startswith("load"):
                self._do("load", self.folder, "--rollback", "--yes")
                if not same(self.world.cell.controller.geometry(), self.old):
                    self._break("what was loaded is not taken back")
        return self

    def live(self):
        """The outcomes that count of the last series, if it began in this story."""
        new = self.records[self.first :]
        last = max((row.series for row in new if row.series), default=0)
        return live_outcomes([row for row in new if row.series == last])

    def _is_done_by_next(self):
        words = self.story.words.format(folder=self.folder, retry=self.rng.choice([0, 0, 3]))
        # what a lying device gave first contradicts all that is true: then the line says so
        has_lied = not self.world.is_hostile and not self.world.faults.keys().isdisjoint(LIES)
        if not self.world.is_hostile and "jog the robot" in self.said:
            self.world.cell.controller.follow(self.home)
        is_told = has_lied and "--anew" in self.said.rpartition(" → ")[2]
        self._do(*words.split(), *(["--anew"] if is_told else []))
        return self.codes[-1] in self.story.codes

    def _passes(self):
        """Let time pass; somebody acknowledges what is pending, or leaves a file there."""
        world, rng = self.world, self.rng
        world.sleep_s(rng.choice([1.0, 20.0, 200.0]))
        if rng.random() < 0.5:
            world.acknowledge()
        if rng.random() < 0.3:
            name = rng.choice(["campaign.lock", "campaign.db.new", ".plan.csv.1.new", "notes~"])
            (self.folder / name).write_text(rng.choice(["", "{", '{"pid": 1}', "\0" * 5000]))
        return False

    def _do(self, *words):
        """Run a command in the world, and look at what it leaves."""
        world, had_new = self.world, same(self.world.cell.controller.geometry(), self.new)
        was_open = has_open_load(self.records)
        world.is_stopped, code = False, "killed"
        try:
            code, self.said = ended(*words)
        except BaseException as error:  # noqa: BLE001 - nothing may come out of a command
            if not isinstance(error, Killed):
                code, self.said = "escaped", traceback.format_exc()
        if world.is_killed:
            code, world.is_killed = "killed", False
            shutil.rmtree(self.folder)
            self.folder.with_suffix(".killed").rename(self.folder)
            (self.folder / "campaign.db-shm").unlink(missing_ok=True)  # was memory, not disk
        self.codes.append(code)
        try:
            before, self.records = self.records, rows(self.folder)
            require_whole(self.folder, before, self.records)
        except Exception as error:  # noqa: BLE001 - also of a journal that cannot be read
            self._break(f"{type(error).__name__}: {error}")
        self._look(words, code, had_new=had_new)
        is_open = was_open or has_open_load(self.records)
        if is_open and code != "killed" and "not ended" not in self.said:
            self._break(f"ended with {code}, and nobody names the open load")
        if any(self.folder.glob("*-rescued-*")):
            self._break("records of a whole journal were rescued")
        for pipe in world.pipes:  # which end with the process
            pipe.close()

    def _look(self, words, code, *, had_new):
        """See how the command ended, and what controller and robot are left with."""
        controller = self.world.cell.controller
        has_new = same(controller.geometry(), self.new)
        if code in {70, "escaped"}:
            self._break(f"ended with {code}")
        if not has_new and not same(controller.geometry(), self.old):
            self._break("the controller holds a mixed set")
        if code == 0 and self.story.words.startswith("load") and has_new == ("--rollback" in words):
            self._break("exit code 0, and the controller does not hold it")
        if self.name == "import" and len(self.live()) not in {0, self.story.shots}:
            self._break("half an import counts")
        if code == "killed":
            return
        alarms = ("EMERGENCY STOP", "state unknown")
        if controller.is_moving(self.world.now_s()) and not any(x in self.said for x in alarms):
            self._break("it moves at the end, and nobody says so")
        if has_new and not had_new and not any(x in self.said for x in ("load", "parameters")):
            self._break("it was loaded, and nobody says so")

    def _break(self, what):
        self.broken.append(f"{what}: {self.said[-400:]}")


def same(one, other):
    return all(abs(one[name] - other.get(name, 0.0)) < 1e-6 for name in one)
