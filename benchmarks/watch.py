"""What the live page costs a run: time a shot with a page open, and with the watcher halted.

python -m benchmarks.watch [--json]

One run on devices that take 0.2 s for a shot, some ten times as fast as a robot and a tracker, with
a real journal. Beside it `pkmcal watch` and a reader of its news, processes of their own. Every
few shots the watcher is halted, and let go again: ratios are of neighbouring stretches of one run,
of their medians from one measurement to the next. Limit: 1.05. The engine's own part of that time
is told beside it.
"""

import http.client
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from urllib.parse import urlsplit

import numpy as np
import psutil

from benchmarks.engine import InstantTracker, run
from benchmarks.shared.programs import PKMCAL, pkmcal
from benchmarks.shared.yardstick import Figure, Report, main
from campaigns.campaign import open_campaign
from drivers.values import Measurement

LIMIT = 1.05
STRETCH = 8
"""Shots between two changes."""
FIRST = 1
"""Shots of a stretch that are left out: it is changed in the middle of them."""
PACE_S = 0.2


@dataclass
class WatchedTracker(InstantTracker):
    """Takes its time over a measurement, and halts the watcher or lets it go."""

    watcher: int = 0

    def measure(self) -> Measurement:
        if self.asked % STRETCH == 0:
            halted = (self.asked // STRETCH) % 2 == 0
            os.kill(self.watcher, signal.SIGSTOP if halted else signal.SIGCONT)
        measured = super().measure()
        time.sleep(PACE_S)
        self.answered = (time.perf_counter(), time.process_time())
        return measured


def measure() -> Report:
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "campaign"
        pkmcal("new", str(folder))
        pkmcal("plan", str(folder))
        watch = subprocess.Popen([PKMCAL, "watch", str(folder), "--json"], stdout=subprocess.PIPE)
        assert watch.stdout is not None
        url = json.loads(watch.stdout.readline())["url"]
        page = subprocess.Popen([sys.executable, __file__, url], stdout=subprocess.PIPE)
        try:
            plan = open_campaign(folder).read_plan()
            tracker = run(folder, plan, partial(WatchedTracker, watcher=watch.pid))
            spent_s = sum(psutil.Process(watch.pid).cpu_times()[:2])
        finally:
            watch.send_signal(signal.SIGCONT)
            watch.terminate()
            watch.communicate()
            news = page.communicate()[0]
    own_s, shots = np.array(tracker.wall_s), len(tracker.wall_s)
    whole, own = _ratios(own_s + PACE_S), _ratios(own_s)
    ratio, own_ms = float(np.median(whole)), 1e3 * float(np.median(own_s))
    return Report(
        [
            Figure("time a shot, watched by not", ratio, "", highest=LIMIT),
            Figure("lowest", float(whole.min())),
            Figure("highest", float(whole.max())),
            Figure("the engine's own part, likewise", float(np.median(own))),
            Figure("the engine's own part, median", own_ms, "ms a shot"),
            Figure("watcher's processor time", 1e3 * spent_s / shots, "ms a shot"),
            Figure("news on the page", int(news)),
            Figure("shots", shots),
        ]
    )


def _ratios(times_s: np.ndarray) -> np.ndarray:
    """Medians of watched stretches by those of the stretches before and after."""
    whole = times_s[: len(times_s) // STRETCH * STRETCH].reshape(-1, STRETCH)
    medians = np.median(whole[:, FIRST:], axis=1)
    return np.array(
        [
            medians[n] / np.mean([medians[n - 1], *medians[n + 1 : n + 2]])
            for n in range(1, len(medians), 2)
        ]
    )


def read_news(url: str) -> int:
    """Number of states that came until the server ended."""
    with closing(http.client.HTTPConnection(urlsplit(url).netloc, timeout=60.0)) as link:
        link.request("GET", "/events")
        return sum(line.startswith(b"data: ") for line in link.getresponse())


if __name__ == "__main__":
    if sys.argv[1:] and sys.argv[1].startswith("http"):
        print(read_news(sys.argv[1]))
        raise SystemExit
    raise SystemExit(main(__doc__, measure))
