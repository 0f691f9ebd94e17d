"""Seeds that never end, or at which their process dies; says what came of them and of the workers.

    stopped_workers.py SIGINT|SIGTERM|die PROCESSES

SIGINT goes to the whole group of processes, as Ctrl-C on a terminal does; SIGTERM to the first.
"""

import os
import signal
import sys
import time
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from threading import Thread

import psutil
from made_up import result

from app.cli import reproduce
from app.console import Terminal
from app.papers.corbel2006.trials import trial_table, trials
from campaigns.errors import Interrupted

LONG_S = 300.0


def endless(folder, room, trial):
    """Work that says who does it and does not end."""
    (Path(folder) / str(os.getpid())).touch()
    time.sleep(LONG_S)


def deadly(folder, room, trial):
    """Work that kills its process at one seed."""
    (Path(folder) / str(os.getpid())).touch()
    if trial.seed == 2:
        os._exit(9)
    return (result(trial.experiment, trial.seed),)


def stop(folder, number):
    """Wait for the first that works, and end all."""
    while not any(Path(folder).iterdir()):
        time.sleep(0.01)
    (os.killpg if number is signal.SIGINT else os.kill)(os.getpid(), number)


def told(how, processes, folder, table):
    """What came of it."""
    reproduce.rehearsed = partial(deadly if how == "die" else endless, folder)
    wanted = trials(2)[:4]
    if how != "die":
        Thread(target=stop, args=(folder, signal.Signals[how]), daemon=True).start()
    try:
        found, failed = reproduce.measure(table, wanted, processes, Terminal(as_json=True))
    except Interrupted as stopped:
        return "Interrupted" if "finished seeds are kept" in str(stopped) else str(stopped)
    alone = [trial for trial, why in failed if "process that computed it was killed" in why]
    kept = len(found) == len(table.read()) == 3
    return "named" if alone == [wanted[3]] and kept else str(failed)


def main():
    how, processes = sys.argv[1:]
    with TemporaryDirectory() as folder, TemporaryDirectory() as tables:
        said = [told(how, int(processes), folder, trial_table(Path(tables) / "results.jsonl"))]
        workers = [int(path.name) for path in Path(folder).iterdir()]
        assert workers
        assert os.getpid() not in workers
        left = [process for process in workers if psutil.pid_exists(process)]
        said.append("gone" if not left else f"left {left}")
    sys.stdout.write("\n".join(said))


if __name__ == "__main__":
    main()
