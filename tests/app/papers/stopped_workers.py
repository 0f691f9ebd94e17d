"""Seeds that never end; says what came of them when they were stopped, and of the workers.

    stopped_workers.py SIGINT|SIGTERM PROCESSES

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

from app.cli import reproduce
from app.console import Terminal
from app.papers.corbel2006.trials import trial_table, trials
from campaigns.errors import Interrupted

LONG_S = 300.0


def endless(folder, room, trial):
    """Work that says who does it and does not end."""
    (Path(folder) / str(os.getpid())).touch()
    time.sleep(LONG_S)


def stop(folder, number):
    """Wait for the first that works, and end all."""
    while not any(Path(folder).iterdir()):
        time.sleep(0.01)
    (os.killpg if number is signal.SIGINT else os.kill)(os.getpid(), number)


def told(how, processes, folder, table):
    """What came of it."""
    reproduce.rehearsed = partial(endless, folder)
    Thread(target=stop, args=(folder, signal.Signals[how]), daemon=True).start()
    try:
        return str(reproduce.measure(table, trials(2)[:4], processes, Terminal(as_json=True)))
    except Interrupted as stopped:
        return "Interrupted" if "finished seeds are kept" in str(stopped) else str(stopped)


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
