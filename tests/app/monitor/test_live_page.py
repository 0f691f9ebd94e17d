"""The live page: what it shows of a campaign, and who may see it."""

import http.client
import json
import shutil
import socket
import sqlite3
import threading
from contextlib import ExitStack, closing
from dataclasses import replace
from datetime import datetime
from pathlib import Path

import pytest
from paper_campaign import CENTRE, MECHANISM, new_campaign

from app.monitor import live_state as module
from app.monitor import server as server_module
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


def test_the_reflector_that_is_measured_is_named(state_of_run):
    shown = state_of_run((replace(ASKED, reflector="half 2"),))
    assert shown["reflector"] == "half 2"


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
    shown = live_state(paper.folder)
    assert (shown["colour"], shown["state"]) == ("grey", "cannot be read")
    (paper.folder / "campaign.yaml").unlink()
    assert "campaign.yaml" in live_state(paper.folder)["detail"]


class Clock:
    """Seconds that pass when the test says so."""

    def __init__(self):
        self.s = 100.0

    def __call__(self):
        return self.s


@pytest.fixture
def looked(tmp_path, monkeypatch):
    """A server that nobody visits, with its clock, and how long each of its looks takes."""
    paper = new_campaign(tmp_path / "c")
    clock, look_s = Clock(), [0.1]

    def looks(folder):
        clock.s += look_s[0]
        return live_state(folder)

    monkeypatch.setattr(server_module, "live_state", looks)
    with LiveServer("127.0.0.1", 0, paper.folder, clock) as server:
        yield server, clock, look_s


def state_of(server):
    return json.loads(server.state_text())


@pytest.mark.parametrize(
    "harm",
    [
        shutil.rmtree,
        lambda folder: folder.rename(folder.with_name("renamed")),
        lambda folder: (folder / "campaign.yaml").unlink(),
        lambda folder: (folder / "campaign.yaml").write_text("name: ["),
    ],
)
@pytest.mark.parametrize("takes_s", [0.01, 1.0, 10.0])
def test_a_folder_that_is_gone_or_broken_is_grey_within_5_s(looked, tmp_path, harm, takes_s):
    server, clock, look_s = looked
    look_s[0] = takes_s
    state_of(server)
    harm(tmp_path / "c")
    clock.s += 4.0 - takes_s  # the page asks each second: at the latest now, or a second later
    state_of(server)
    clock.s += 1.0
    shown = state_of(server)
    assert shown["colour"] == "grey"
    assert shown["state"].startswith(("cannot be read", "last read"))


def test_a_state_that_is_not_read_again_in_time_turns_grey(looked, monkeypatch):
    server, clock, _ = looked
    monkeypatch.setattr(server_module, "live_state", lambda _: {"colour": "green", "state": "s"})
    assert state_of(server) == {"colour": "green", "state": "s"}
    with server._looking:  # by another visit
        clock.s += 3.0
        assert state_of(server)["colour"] == "green"
        clock.s += 2.0
        assert state_of(server) == {"colour": "grey", "state": "last read 5 s ago"}
    assert state_of(server)["colour"] == "green"


def test_a_working_directory_that_was_deleted_is_a_state_too(tmp_path, monkeypatch):
    paper = new_campaign(tmp_path / "c")
    monkeypatch.chdir(paper.folder)
    with LiveServer("127.0.0.1", 0, Path()) as server:
        assert state_of(server)["name"] == "paper"
        shutil.rmtree(paper.folder)
        server._look_again_s = 0.0
        assert state_of(server) | {"detail": ""} == {
            "name": "c",
            "colour": "grey",
            "state": "cannot be read",
            "detail": "",
        }


def test_a_hundred_connections_at_once_are_taken(tmp_path):
    folder = new_campaign(tmp_path / "c").folder
    with LiveServer("127.0.0.1", 0, folder) as server, ExitStack() as links:
        for _ in range(100):  # nothing is accepted yet
            address = ("127.0.0.1", server.server_address[1])
            links.enter_context(socket.create_connection(address, timeout=0.5))


def test_more_silent_visitors_than_threads_do_not_keep_others_away(serve, monkeypatch):
    monkeypatch.setattr(server_module, "MOST_VISITS", 3)
    monkeypatch.setattr(server_module, "FULL_HOUSE_S", 0.01)
    server = serve()
    with ExitStack() as links:
        address = ("127.0.0.1", server.server_address[1])
        silent = [
            links.enter_context(socket.create_connection(address, timeout=5.0)) for _ in range(8)
        ]
        assert silent[-1].recv(1) == b""  # sent away, while the first ones have time left
        for visitor in silent[:3]:
            visitor.setblocking(False)
            with pytest.raises(BlockingIOError):
                visitor.recv(1)
            visitor.close()
        monkeypatch.setattr(server_module, "FULL_HOUSE_S", 2.0)  # until their threads notice it
        assert ask(server, "/")[0] == 200


def test_the_icon_is_for_all(serve):
    code, headers, icon = ask(serve("0.0.0.0"), "/favicon.ico")
    assert (code, headers["Content-Type"].partition(";")[0]) == (200, "image/svg+xml")
    assert icon.startswith("<svg")


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
