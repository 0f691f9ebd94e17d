"""How soon a wish to stop is on the controller's wire, whatever is pending on either link.

python -m benchmarks.torture.signals [--tries N] [--cells N] [--json]

A run on a simulated cell in real time gets a signal at a random moment: while the robot moves;
while the tracker's answer is pending; while the controller has stopped answering; while it answers
0.8 s late. From the signal to the STOP that a relay sees on the controller's wire, by the monotonic
clock. Every run has then to end in order: exit code 130, and Ctrl-Z suspended it first. Several
cells side by side, each try in the next one that is free.
"""

import multiprocessing
import os
import random
import shutil
import signal
import statistics
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from queue import Empty, SimpleQueue

import psutil
from ruamel.yaml import YAML

from benchmarks.shared.programs import pkmcal
from benchmarks.shared.relay import Relay
from benchmarks.shared.yardstick import Figure, Report, Table, main
from sim.cell import Cell
from sim.clock import ScaledClock
from sim.embedded import EmbeddedCell
from sim.scenarios.scenario import load_scenario

LIMIT_S = 0.1
SIGNALS = ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP")
SETTINGS = {"plan.shots": 48, "plan.validation_pairs": 4}
SLOW_S = 0.8
PATIENCE_S = 60.0
INTERRUPTED = 130
PRELOADED = ["app.cli.run", "app.wiring", "app.measuring"]


@dataclass(frozen=True, slots=True)
class Wires:
    """The relays before both devices."""

    controller: Relay
    tracker: Relay


def while_moving(wires: Wires, rng: random.Random) -> None:
    """Wait until the robot is on its way."""
    wires.controller.await_heard_s(b" MOVEJ ", within_s=PATIENCE_S)
    time.sleep(rng.uniform(0.0, 0.3))


def while_measuring(wires: Wires, rng: random.Random) -> None:
    """Wait until the tracker measures, and never answers."""
    moved_s = wires.controller.await_heard_s(b" MOVEJ ", within_s=PATIENCE_S)
    wires.tracker.await_heard_s(since_s=moved_s, within_s=PATIENCE_S)
    wires.tracker.frozen = True
    time.sleep(rng.uniform(0.0, 1.0))


def while_frozen(wires: Wires, rng: random.Random) -> None:
    """Wait until the controller has not answered for a while."""
    while_moving(wires, rng)
    wires.controller.frozen = True
    time.sleep(rng.uniform(0.05, 1.5))


def while_slow(wires: Wires, rng: random.Random) -> None:
    """Wait until the controller has begun to take its time."""
    while_moving(wires, rng)
    wires.controller.delay_s = SLOW_S
    time.sleep(rng.uniform(0.05, 1.5))


SITUATIONS: Mapping[str, Callable[[Wires, random.Random], None]] = {
    "moving": while_moving,
    "measuring, tracker frozen": while_measuring,
    "controller frozen": while_frozen,
    "controller slow": while_slow,
}


def run_in(folder: str) -> None:
    """The program in a process that has everything imported already, in a job of its own."""
    os.setpgid(0, 0)
    for name in SIGNALS:
        signal.signal(getattr(signal, name), signal.SIG_DFL)  # also where this runs under nohup
    signal.signal(signal.SIGINT, signal.default_int_handler)
    nowhere = os.open(os.devnull, os.O_RDWR)
    for number in range(3):
        os.dup2(nowhere, number)
    from app.main import run_command  # where it is run

    sys.exit(run_command(["run", folder, "--yes"]))


def one_try(folder: Path, wires: Wires, number: int, wait: Callable[[], None]) -> float:
    """Seconds from the signal to STOP on the wire; raises `AssertionError` for a wrong end."""
    wires.controller.forget()
    wires.tracker.forget()
    process = multiprocessing.get_context("forkserver").Process(target=run_in, args=(str(folder),))
    process.start()
    try:
        wait()
        assert process.pid is not None
        asked_s = time.monotonic()
        os.kill(process.pid, number)
        heard_s = wires.controller.await_heard_s(b" STOP ", since_s=asked_s, within_s=PATIENCE_S)
        wires.controller.frozen = wires.tracker.frozen = False
        if number == signal.SIGTSTP:
            await_suspended(process.pid)
            os.kill(process.pid, signal.SIGCONT)
        process.join(PATIENCE_S)
        assert process.exitcode == INTERRUPTED, f"exit code {process.exitcode}"
    finally:
        process.kill()
        process.join()
        process.close()
    return heard_s - asked_s


def await_suspended(number: int) -> None:
    give_up_s = time.monotonic() + PATIENCE_S
    while psutil.Process(number).status() != psutil.STATUS_STOPPED:
        assert time.monotonic() < give_up_s, "not suspended"
        time.sleep(0.01)


def planned_campaign(folder: Path, wires: Wires) -> None:
    pkmcal("new", str(folder), "--scenario", "paper-simulation")
    yaml, path = YAML(), folder / "campaign.yaml"
    tree = yaml.load(path.read_text(encoding="utf-8"))
    urls = {"controller.url": wires.controller.url, "tracker.url": wires.tracker.url}
    for name, value in (SETTINGS | urls).items():
        section, key = name.split(".")
        tree[section][key] = value
    with path.open("w", encoding="utf-8") as file:
        yaml.dump(tree, file)
    pkmcal("plan", str(folder))


@dataclass(frozen=True, slots=True)
class Try:
    """One signal in one situation."""

    situation: str
    name: str
    number: int


Found = dict[tuple[str, str], list[float]]


def tried_in_a_cell(tries: SimpleQueue[Try], found: Found, wrong: list[str]) -> None:
    """Take tries from the queue until it is empty, all in one cell of their own."""
    cell = EmbeddedCell(Cell(load_scenario("paper-simulation")), ScaledClock(1.0))
    with (
        tempfile.TemporaryDirectory() as room,
        cell,
        Relay(cell.controller_url) as controller,
        Relay(cell.tracker_url) as tracker,
    ):
        wires = Wires(controller, tracker)
        campaign = Path(room) / "campaign"
        planned_campaign(campaign, wires)
        while not tries.empty():
            try:
                each = tries.get_nowait()
            except Empty:
                return
            rng = random.Random(f"{each}")
            wait = partial(SITUATIONS[each.situation], wires, rng)
            folder = Path(shutil.copytree(campaign, Path(room) / "one"))
            try:
                took_s = one_try(folder, wires, signal.Signals[each.name], wait)
                found[each.situation, each.name].append(took_s)
                told = f"{each.situation}, {each.name}, {each.number}: {1e3 * took_s:.1f} ms"
                print(told, file=sys.stderr, flush=True)
            except (AssertionError, TimeoutError) as error:
                wrong.append(f"{each}: {error}")
            shutil.rmtree(folder)


def measure(tries: int, cells: int) -> Report:
    multiprocessing.get_context("forkserver").set_forkserver_preload(PRELOADED)
    found: Found = {(situation, name): [] for situation in SITUATIONS for name in SIGNALS}
    wrong: list[str] = []
    wanted: SimpleQueue[Try] = SimpleQueue()
    for number in range(tries):
        for situation, name in found:
            wanted.put(Try(situation, name, number))
    with ThreadPoolExecutor(cells) as pool:
        for done in [pool.submit(tried_in_a_cell, wanted, found, wrong) for _ in range(cells)]:
            done.result()
    return report(found, wrong)


def percentile_99(times_s: list[float]) -> float:
    """The smallest time that 99 % of the tries keep."""
    ordered = sorted(times_s)
    return ordered[-(len(ordered) // 100) - 1] if ordered else float("nan")


def report(found: Found, wrong: list[str]) -> Report:
    columns = ("", "tries", "median", "p99", "largest")
    rows = [
        (
            f"{situation}, {name}",
            len(times_s),
            1e3 * statistics.median(times_s) if times_s else float("nan"),
            1e3 * percentile_99(times_s),
            1e3 * max(times_s, default=float("nan")),
        )
        for (situation, name), times_s in found.items()
    ]
    figures = []
    for situation in SITUATIONS:
        times_s = [t for (where, _), each in found.items() if where == situation for t in each]
        p99_s = percentile_99(times_s)
        figures.append(Figure(f"STOP on the wire, {situation}, p99", p99_s, "s", highest=LIMIT_S))
    figures.append(Figure("runs that did not end in order", len(wrong), "", highest=0))
    tables = [Table("From the signal to STOP on the wire (ms)", columns, rows)]
    if wrong:
        tables.append(Table("Wrong ends", ("",), [(text,) for text in wrong]))
    return Report(figures, tables)


if __name__ == "__main__":
    raise SystemExit(main(__doc__, measure, tries=50, cells=4))
