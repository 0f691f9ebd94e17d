"""Stops in the middle of work, or lets a worker die; says what came of it and of the workers."""

import os
import sys
import time
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

from app.papers.corbel2006.experiments import trials
from app.papers.corbel2006.runner import Failure, outcomes, worker_processes
from campaigns.errors import Interrupted

LONG_S = 300.0


def endless(folder, trial):
    """Work that says who does it and does not end."""
    (Path(folder) / str(os.getpid())).touch()
    time.sleep(LONG_S)


def deadly(folder, trial):
    """Work at which its process dies."""
    (Path(folder) / str(os.getpid())).touch()
    os._exit(9)


def told(how, folder):
    """What came of it."""
    task = partial(endless if how == "stop" else deadly, folder)
    try:
        with worker_processes(2) as pool:
            found = list(outcomes(trials(1), task, pool, lambda: how == "stop" and any_in(folder)))
    except Interrupted:
        return "Interrupted"
    named = all(isinstance(o, Failure) and "process died" in o.reason for _, o in found)
    return "named" if named and len(found) == len(trials(1)) else str(found)


def any_in(folder):
    return any(Path(folder).iterdir())


def is_alive(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def main():
    with TemporaryDirectory() as folder:
        said = [told(sys.argv[1], folder)]
        workers = [int(path.name) for path in Path(folder).iterdir()]
        assert workers
        left = [process for process in workers if is_alive(process)]
        said.append("gone" if not left else f"left {left}")
    sys.stdout.write("\n".join(said))


if __name__ == "__main__":
    main()
