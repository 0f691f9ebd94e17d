"""The live page: what it shows of a campaign, and who may see it."""

import http.client
import json
import sqlite3
import threading
from contextlib import closing
from datetime import datetime

import pytest
from paper_campaign import CENTRE, MECHANISM, new_campaign

from app.monitor import live_state as module
from app.monitor.live_state import live_state
from app.monitor.server import LiveServer, own_address
from campaigns.files.lock import Holder
from campaigns.journal.records import Event, Intent
from campaigns.planning.plan_file import write_plan
from drivers.values import Pose

SOMEBODY = Holder(1, "cell-pc", "2026-03-02T08:00:00+00:00")
EVIL = "<script>alert(1)</script>\x1b[2J"
LOST, SEEN = Event("beam broken", "lost"), Event("resumed", "seen")
ASKED = Intent(6, 1, "identification", Pose(*CENTRE), (0.0,) * 4, "joints", 3)


@pytest.fixture
def state_of_run(tmp_path, monkeypatch):
    """Gives the state of a run of six of ten shots, with more records behind them."""
    paper = new_campaign(tmp_path / "c")
    plan = paper.plan(3, 1)
    write_plan(paper.campaign.plan_path, plan, MECHANISM)

    def state(more=(), held_by=SOMEBODY, **how):
        monkeypatch.setattr(module, "lock_holder", lambda _folder: held_by)
        series = paper.measure("run", plan[:6], **{"finished": False, "stopped": False} | how)
        with paper.journal() as journal:
            for record in more:
                journal.append(record, series=series)
        return live_state(paper.folder)

    return state


def test_shots_done_and_planned_and_the_end_by_the_clock(state_of_run):
    state = state_of_run()
    assert (state["done"], state["total"]) == (5, 10)  # half a pair does not count
    assert (state["colour"], state["state"]) == ("green", "measuring")
    low, high = (datetime.fromisoformat(end) for end in state["ends_utc"])
    assert 0.0 <= (high - low).total_seconds() < 60.0


@pytest.mark.parametrize(
    ("more", "held_by", "how", "colour", "state"),
    [
        ((), None, {}, "red", "ended without a stop record"),
        ((), None, {"stopped": True}, "green", "stopped"),
        ((), SOMEBODY, {"finished": True}, "green", "finished: pkmcal"),
        ((LOST,), SOMEBODY, {}, "red", "the beam is broken"),
        ((LOST, SEEN), SOMEBODY, {}, "green", "measuring"),
        ((LOST, ASKED), SOMEBODY, {}, "green", "measuring"),
    ],
)
def test_the_last_word_of_the_journal_gives_the_colour(
    state_of_run, more, held_by, how, colour, state
):
    shown = state_of_run(more, held_by, **how)
    assert (shown["colour"], shown["state"][: len(state)]) == (colour, state)


def test_events_are_shown_the_latest_first_and_without_control_characters(state_of_run):
    state = state_of_run((*[LOST] * 20, Event("operator note", EVIL)))
    assert len(state["events"]) == module.EVENTS_SHOWN
    assert state["events"][0]["text"].startswith("<script>")
    assert "\x1b" not in state["events"][0]["text"]


def test_page_says_what_status_says_when_nothing_is_measured_and_when_nothing_can_be_read(tmp_path):
    paper = new_campaign(tmp_path / "c")
    state = live_state(paper.folder)
    assert (state["colour"], state["done"], state["campaign"]) == ("grey", 0, "set up")
    assert "pkmcal" in state["next"]
    paper.measure("before", paper.plan(1, 0))
    assert live_state(paper.folder)["done"] == 4
    other = paper.folder / "other.db"
    with closing(sqlite3.connect(other)) as database:
        database.execute("CREATE TABLE record (x)")
    other.replace(paper.campaign.journal_path)
    assert live_state(paper.folder)["state"] == "cannot be read"
    (paper.folder / "campaign.yaml").unlink()
    assert "campaign.yaml" in live_state(paper.folder)["detail"]


@pytest.fixture
def serve(tmp_path):
    """Serves a campaign at a host."""
    running = []
    folder = new_campaign(tmp_path / "c").folder

    def served(host="127.0.0.1"):
        server = LiveServer(host, 0, folder)
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        running.append((server, thread))
        return server

    yield served
    for server, thread in running:
        server.shutdown()
        server.server_close()
        thread.join()


def ask(server, path, **headers):
    address = ("127.0.0.1", server.server_address[1])
    with closing(http.client.HTTPConnection(*address, timeout=5.0)) as link:
        link.request("GET", path, headers=headers)
        answer = link.getresponse()
        return answer.status, answer.headers, answer.read(200_000).decode()


def test_the_page_runs_no_script_of_others(serve):
    server = serve()
    code, headers, page = ask(server, "/")
    policy = headers["Content-Security-Policy"]
    nonce = policy.partition("'nonce-")[2].partition("'")[0]
    assert (code, page.count(f'nonce="{nonce}"')) == (200, 2)
    assert "default-src 'none'" in policy
    assert ask(server, "/")[1]["Content-Security-Policy"] != policy
    assert "https://" not in page
    code, headers, state = ask(server, "/state")
    assert (code, headers["Content-Type"]) == (200, "application/json; charset=utf-8")
    assert json.loads(state)["state"] == "nothing was measured yet"
    assert ask(server, "/campaign.db")[0] == 404


def test_the_hall_needs_the_token(serve):
    hall = serve("0.0.0.0")
    assert f"http://{own_address()}:" in hall.url
    assert "0.0.0.0" not in hall.url
    token = hall.url.partition("?token=")[2]
    assert len(token) > 20
    assert [ask(hall, path)[0] for path in ("/", "/?token=x", "/state")] == [403, 403, 403]
    assert [ask(hall, f"{path}?token={token}")[0] for path in ("/", "/state")] == [200, 200]


@pytest.mark.parametrize(
    ("host", "code"),
    [
        *((host, 200) for host in ("localhost:1", "127.0.0.1:80", "[::1]:80")),
        *((host, 403) for host in ("localhost:80@evil", "localhost.evil", "")),
    ],
)
def test_loopback_is_asked_for_by_its_own_name(serve, host, code):
    assert ask(serve(), "/", Host=host)[0] == code
