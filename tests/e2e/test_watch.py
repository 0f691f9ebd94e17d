"""`pkmcal watch` beside a run: it is told at once, and outlives the process that measures."""

import http.client
import json
import signal
from contextlib import closing
from datetime import UTC, datetime
from urllib.parse import urlsplit

import pytest
from command_line import change, ended, started

WITHIN_S = 1.0


def told(stream):
    """The next state of an event stream."""
    for line in stream:
        if line.startswith(b"data: "):
            return json.loads(line.removeprefix(b"data: "))
    raise AssertionError("the stream has ended")


@pytest.mark.long
def test_the_page_follows_a_run_and_stays_when_the_run_is_killed(planned):
    change(planned / "cell.yaml", {"speed_up": 20})
    watch = started("watch", planned, "--json")
    run = None
    try:
        address = urlsplit(json.loads(watch.stdout.readline())["url"]).netloc
        with closing(http.client.HTTPConnection(address, timeout=20.0)) as link:
            link.request("GET", "/events")
            news = link.getresponse()
            assert told(news)["state"] == "nothing was measured yet"
            run = started("run", planned, "--yes")
            late_s, state = [], {"done": 0}
            while state["done"] < 5:
                state = told(news)
                if state["latest_utc"]:
                    came = datetime.now(UTC) - datetime.fromisoformat(state["latest_utc"])
                    late_s.append(came.total_seconds())
            assert (state["state"], state["colour"]) == ("measuring", "green")
            # a busy machine may hold one of them up
            assert sorted(late_s)[len(late_s) // 2] < WITHIN_S
            run.send_signal(signal.SIGKILL)
            run.communicate()
            while state["state"] == "measuring":
                state = told(news)
            assert (state["state"], state["colour"]) == ("ended without a word", "red")
            assert watch.poll() is None
    finally:
        for process in filter(None, (run, watch)):
            process.send_signal(signal.SIGTERM)
        stopped = ended(watch)
    assert (stopped.code, "Traceback" in stopped.err) == (0, False)
