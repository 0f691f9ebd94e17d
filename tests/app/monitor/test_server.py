"""The live page's server: who may see it, and how fast its news are there."""

import http.client
import json
import sqlite3
import threading
import time
from contextlib import closing
from urllib.request import urlopen

import pytest
from paper_campaign import new_campaign

from app.monitor.follower import Follower
from app.monitor.live_state import Watched, utc_now
from app.monitor.server import LiveServer, News, follow
from campaigns.journal.records import Event

EVIL = "<script>alert(1)</script>\"'&"


@pytest.fixture
def serve():
    """Serves at a host; gives the server and its news."""
    running = []

    def served(host="127.0.0.1"):
        news = News()
        server = LiveServer(host, 0, news)
        thread = threading.Thread(target=server.serve_forever, args=(0.01,))
        thread.start()
        running.append((server, news, thread))
        return server, news

    yield served
    for server, news, thread in running:
        news.close()
        server.shutdown()
        server.server_close()
        thread.join()
    until = time.monotonic() + 5.0
    while threading.active_count() > 1 and time.monotonic() < until:
        time.sleep(0.002)


def ask(server, path, **headers):
    address = ("127.0.0.1", server.server_address[1])
    with closing(http.client.HTTPConnection(*address, timeout=5.0)) as link:
        link.request("GET", path, headers=headers)
        answer = link.getresponse()
        return answer.status, answer.headers, answer.read(200_000).decode()


def test_the_page_holds_its_first_state_as_text_and_runs_no_script_of_others(serve):
    server, news = serve()
    news.publish({"name": EVIL, "now_utc": "2026-03-02T08:00:00+00:00"})
    code, headers, page = ask(server, "/")
    assert code == 200
    assert EVIL not in page
    assert "\\u003cscript>alert(1)" in page
    policy = headers["Content-Security-Policy"]
    nonce = policy.partition("'nonce-")[2].partition("'")[0]
    assert page.count(f'nonce="{nonce}"') == 2
    assert "default-src 'none'" in policy
    assert ask(server, "/")[1]["Content-Security-Policy"] != policy
    assert "https://" not in page


def test_news_come_at_once_to_each_that_waits(serve):
    server, news = serve()
    with closing(http.client.HTTPConnection("127.0.0.1", server.server_address[1])) as link:
        link.request("GET", "/events")
        answer = link.getresponse()
        news.publish({"done": 1})
        assert json.loads(answer.readline().removeprefix(b"data: ")) == {"done": 1}
        assert answer.readline() == b"\n"
        news.publish({"done": 2})
        assert b'"done": 2' in answer.readline()


def test_the_hall_needs_the_token_and_loopback_its_own_name(serve):
    hall, _ = serve("0.0.0.0")
    token = hall.url.partition("?token=")[2]
    assert len(token) > 20
    assert [ask(hall, path)[0] for path in ("/", "/?token=x", "/events")] == [403, 403, 403]
    assert ask(hall, f"/?token={token}")[0] == 200
    own, _ = serve()
    assert ask(own, "/campaign.db")[0] == 404


@pytest.mark.parametrize("host", ["localhost", "localhost:1", "127.0.0.1:80", "[::1]:80"])
def test_loopback_is_asked_for_by_its_own_name(serve, host):
    assert ask(serve()[0], "/", Host=host)[0] == 200


@pytest.mark.parametrize(
    "host", ["evil.example", "localhost:80@evil", "localhost.evil", "[[::1]]", "evil@localhost", ""]
)
def test_any_other_name_of_loopback_is_refused(serve, host):
    assert ask(serve()[0], "/", Host=host)[0] == 403


def test_page_is_served_over_version_6_of_the_protocol_too(serve):
    server, _ = serve("::1")
    assert server.url == f"http://[::1]:{server.server_address[1]}/"
    with urlopen(server.url, timeout=5.0) as answer:
        assert answer.status == 200


def test_a_follower_tells_what_is_new_and_nothing_twice(tmp_path):
    paper = new_campaign(tmp_path / "c")
    with closing(Follower(paper.folder, utc_now)) as follower:
        assert follower.news()["state"] == "nothing was measured yet"
        assert follower.news() is None
        paper.measure("before", paper.plan(1, 0), finished=False, stopped=False)
        first = follower.news()
        assert (first["done"], first["state"]) == (4, "ended without a word")
        assert follower.news() is None
        paper.run(pairs=1, unseen=1)
        second = follower.news()
        assert (second["stage"], second["done"], second["colour"]) == ("run", 6, "green")
        paper.campaign.journal_path.unlink()
        assert follower.news()["state"] == "nothing was measured yet"


def test_a_follower_takes_up_each_record_once_and_tells_what_a_new_one_would(tmp_path, monkeypatch):
    paper, taken, take_up = new_campaign(tmp_path / "c"), [], Watched.take_up

    def counted(watched, entries):
        taken.append(len(entries))
        take_up(watched, entries)

    monkeypatch.setattr(Watched, "take_up", counted)
    paper.measure("before", paper.plan(1, 0))
    series = paper.measure("run", paper.plan(1, 1), finished=False, stopped=False)
    with closing(Follower(paper.folder, utc_now)) as follower:
        follower.news()
        with paper.journal() as journal:
            for shot, kind in ((1, "shot skipped"), (90, "beam broken")):
                journal.append(Event(kind, f"shot {shot}", (shot,)), series=series)
            whole = journal.last_number()
        grown = follower.news()
        assert taken == [whole - 2, 2]
        with closing(Follower(paper.folder, utc_now)) as new:
            told = new.news()
    assert [each["text"] for each in told["events"]] == ["shot 90", "shot 1"]
    assert {**grown, "now_utc": ""} == {**told, "now_utc": ""}


def test_a_journal_that_cannot_be_read_is_said_and_the_follower_lives_on(tmp_path):
    paper = new_campaign(tmp_path / "c")
    paper.measure("before", paper.plan(1, 0))
    with closing(Follower(paper.folder, utc_now)) as follower:
        assert follower.news()["done"] == 4
        other = paper.folder / "other.db"
        with closing(sqlite3.connect(other)) as database:
            database.execute("CREATE TABLE record (x)")
        other.replace(paper.campaign.journal_path)
        assert follower.news()["state"] == "cannot be read"
        assert follower.news() is None


def test_settings_that_are_broken_or_gone_are_said_without_news_of_the_journal(tmp_path):
    paper = new_campaign(tmp_path / "c")
    paper.measure("before", paper.plan(1, 0))
    path = paper.folder / "campaign.yaml"
    text = path.read_text(encoding="utf-8")
    with closing(Follower(paper.folder, utc_now)) as follower:
        assert follower.news()["done"] == 4
        for break_it in (lambda: path.write_text("{", encoding="utf-8"), path.unlink):
            break_it()
            broken = follower.news()
            assert (broken["state"], follower.news()) == ("cannot be read", None)
            assert "campaign.yaml" in broken["detail"]
            path.write_text(text, encoding="utf-8")
            assert follower.news()["done"] == 4


def test_following_ends_when_it_is_told_to():
    news, looks = News(), iter([{"done": 1}, None, {"done": 2}])
    waits = iter([False, False, True])
    follow(lambda: next(looks), news, lambda: next(waits))
    assert json.loads(news.latest) == {"done": 2}
