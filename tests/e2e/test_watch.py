"""`pkmcal watch` beside a run: it is told at once, and outlives the process that measures."""

import json
import os
import resource
import signal
import time
from datetime import UTC, datetime
from pathlib import Path
from urllib.request import urlopen

import pytest
from command_line import change, ended, started

WITHIN_S = 2.0


@pytest.mark.long
def test_the_page_follows_a_run_and_stays_when_the_run_is_killed(planned):
    change(planned / "cell.yaml", {"speed_up": 20})
    watch = started("watch", planned, "--json")
    run = None

    def state():
        with urlopen(f"{url}state", timeout=20.0) as answer:
            return json.load(answer)

    def wait_for(is_there):
        while not is_there(shown := state()):
            time.sleep(0.1)
        return shown

    try:
        url = json.loads(watch.stdout.readline())["url"]
        assert state()["state"] == "nothing was measured yet"
        run = started("run", planned, "--yes")
        shown = wait_for(lambda shown: shown["done"] >= 5)
        assert (shown["state"], shown["colour"]) == ("measuring", "green")
        late = datetime.now(UTC) - datetime.fromisoformat(shown["latest_utc"])
        assert late.total_seconds() < WITHIN_S
        run.send_signal(signal.SIGKILL)
        run.communicate()
        shown = wait_for(lambda shown: shown["state"] != "measuring")
        assert (shown["state"], shown["colour"]) == ("ended without a stop record", "red")
        assert watch.poll() is None
    finally:
        for process in filter(None, (run, watch)):
            process.send_signal(signal.SIGTERM)
        stopped = ended(watch)
    assert (stopped.code, "Traceback" in stopped.err) == (0, False)


def used_s(pid):
    """Seconds of the processor that a process has used so far."""
    words = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")


def of_children_s():
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def test_a_signal_ends_it_without_further_work(planned):
    """Python takes its modules apart at its end: 0.3 s, and several seconds beside a run."""
    before_s = of_children_s()
    watch = started("watch", planned, "--json")
    try:
        url = json.loads(watch.stdout.readline())["url"]
        with urlopen(f"{url}state", timeout=20.0):
            until_signal_s = used_s(watch.pid)
    finally:
        watch.send_signal(signal.SIGTERM)
        stopped = ended(watch)
    assert (stopped.code, "Traceback" in stopped.err) == (0, False)
    assert of_children_s() - before_s - until_signal_s < 0.1
