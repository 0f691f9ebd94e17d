"""Server of the live page: one page, and its news as server-sent events.

Only reads. Nothing that a visitor sends is used but the path, the token and the name of the host.
"""

import json
import re
import secrets
import socket
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from urllib.parse import parse_qs, urlsplit

from typing_extensions import override

LOOPBACK = ("127.0.0.1", "localhost", "::1")
_ITS_OWN_NAME = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:[0-9]+)?")
MOST_WATCHERS = 32
"""Pages that may be open at once."""
KEEP_ALIVE_S = 5.0
SLOW_READER_S = 10.0
PAGE = "live.html"


class News:
    """Latest state, and a signal to whoever waits for the next."""

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._number, self._text, self._closed = 0, "{}", False

    def publish(self, state: dict[str, object]) -> None:
        """Tell all that wait."""
        with self._changed:
            self._number, self._text = self._number + 1, json.dumps(state, allow_nan=False)
            self._changed.notify_all()

    def close(self) -> None:
        """Let all that wait go."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def after(self, number: int, within_s: float) -> tuple[int, str] | None:
        """Number and text of the state that came after that one; None: none came in time."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._number > number, within_s)
            return (self._number, self._text) if self._number > number else None

    @property
    def latest(self) -> str:
        """Text of the latest state."""
        return self._text

    @property
    def closed(self) -> bool:
        """Whether no more will come."""
        return self._closed


class LiveServer(ThreadingHTTPServer):
    """Server at an address; a host other than this machine's own asks for the token."""

    daemon_threads = True

    def __init__(self, host: str, port: int, news: News) -> None:
        self.token = "" if host in LOOPBACK else secrets.token_urlsafe(16)
        self.news, self.host = news, host
        self.watchers = threading.Semaphore(MOST_WATCHERS)
        self.page = resources.files("app.monitor").joinpath(PAGE).read_text(encoding="utf-8")
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        super().__init__((host, port), _Visit)

    @property
    def url(self) -> str:
        """Address to open."""
        query = f"?token={self.token}" if self.token else ""
        host = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{host}:{self.server_address[1]}/{query}"

    @override
    def handle_error(self, request: object, client_address: object) -> None:
        """A visitor who left is nobody's error."""


class _Visit(BaseHTTPRequestHandler):
    server: LiveServer
    timeout = SLOW_READER_S
    server_version, sys_version = "pkmcal", ""

    def do_GET(self) -> None:
        """The page or its news, for whoever may have them."""
        address = urlsplit(self.path)
        if not self._is_welcome(parse_qs(address.query).get("token", [""])[0]):
            self._refuse(403, "the address that `pkmcal watch` printed has a token: use it whole\n")
        elif address.path == "/":
            self._send_page()
        elif address.path == "/events":
            self._send_news()
        else:
            self._refuse(404, "there is only /\n")

    def _is_welcome(self, token: str) -> bool:
        """Whether the token is right; on loopback, whether it was asked for by that name.

        A page from elsewhere that has its own name point here would have another.
        """
        if self.server.token:
            return secrets.compare_digest(token.encode(), self.server.token.encode())
        return _ITS_OWN_NAME.fullmatch(self.headers.get("Host", "")) is not None

    def _send_page(self) -> None:
        nonce = secrets.token_urlsafe(16)
        state = self.server.news.latest.replace("<", "\\u003c")
        body = self.server.page.replace("NONCE", nonce).replace("STATE", state).encode()
        self.send_response(200)
        self.send_header("Content-Type", "text/html; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        self._keep_in(f"script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; connect-src 'self'")
        self.end_headers()
        self.wfile.write(body)

    def _send_news(self) -> None:
        if not self.server.watchers.acquire(blocking=False):
            self._refuse(503, f"{MOST_WATCHERS} pages are open already\n")
            return
        try:
            self.send_response(200)
            self.send_header("Content-Type", "text/event-stream")
            self.send_header("Connection", "close")
            self._keep_in("")
            self.end_headers()
            number, news = 0, self.server.news
            while not news.closed:
                found = news.after(number, KEEP_ALIVE_S)
                if found is None:
                    self.wfile.write(b": still here\n\n")
                else:
                    number, text = found
                    self.wfile.write(f"data: {text}\n\n".encode())
                self.wfile.flush()
        except OSError:
            pass  # the visitor left
        finally:
            self.server.watchers.release()

    def _keep_in(self, allowed: str) -> None:
        policy = f"default-src 'none'; base-uri 'none'; frame-ancestors 'none'; {allowed}"
        self.send_header("Content-Security-Policy", policy)
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")

    def _refuse(self, code: int, text: str) -> None:
        self.send_response(code)
        self.send_header("Content-Type", "text/plain; charset=utf-8")
        self.send_header("Content-Length", str(len(text.encode())))
        self._keep_in("")
        self.end_headers()
        self.wfile.write(text.encode())

    @override
    def log_message(self, format: str, *arguments: object) -> None:
        """Say nothing of visits."""


def follow(
    look: Callable[[], dict[str, object] | None], news: News, wait: Callable[[], bool]
) -> None:
    """Publish what is new until the wait says that it is over."""
    while True:
        state = look()
        if state is not None:
            news.publish(state)
        if wait():
            return
