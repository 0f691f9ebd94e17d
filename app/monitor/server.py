"""Server of the live page: the page, and its state as JSON, which the page asks for.

The server only reads. Of what a visitor sends it uses the path, the token and the host's name.
Nothing that is shown in colour is older than a few seconds: a state that could not be read again in
time, as on a machine that has no time left, turns grey.
"""

# Who may see the page. On loopback there is no token, because only this machine can connect. But a
# browser on this machine may be lured: a foreign page can give its own name the address 127.0.0.1
# (DNS rebinding) and then read what is served here. Such a request carries the foreign name in its
# Host header, so only loopback's own names are answered. At any other address a random token in the
# URL is the password; it is compared in constant time.
#
# The page gets a new nonce with each visit, and its Content-Security-Policy allows no other script
# or style: a text from the journal can never run as a script.

import json
import re
import secrets
import socket
import threading
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib import resources
from pathlib import Path
from time import monotonic
from typing import Any
from urllib.parse import parse_qs, urlsplit

from typing_extensions import override

from app.monitor.live_state import live_state

LOOPBACK = ("127.0.0.1", "localhost", "::1")
CONNECTING = {"colour": "grey", "state": "not read yet", "detail": ""}
_NAMES_OF_LOOPBACK = re.compile(r"(127\.0\.0\.1|localhost|\[::1\])(:[0-9]+)?")
LOOK_EVERY_S = 0.5
PAUSE_PER_LOOK = 4.0
"""Pause after a look, in multiples of its duration: the run needs the processor."""
LONGEST_PAUSE_S = 2.0
"""Longest pause between two looks, however long they take."""
STALE_S = 4.0
"""Age from which a state is grey; the page asks each second, so that it is grey within 5 s."""
SLOW_READER_S = 3.0
"""Longest wait for a visitor's bytes."""
MOST_VISITS = 64
"""Visits that are answered at once, each by a thread."""
FULL_HOUSE_S = 0.2
"""Longest wait of a further visitor until one of them has ended; then he is sent away."""
ICON = (
    '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 16 16">'
    '<circle cx="8" cy="8" r="7" fill="#2c6a3f"/></svg>'
)


class LiveServer(ThreadingHTTPServer):
    """Server of one campaign at an address; a host other than this machine asks for a token."""

    daemon_threads = True
    request_queue_size = 128
    """Visitors who wait for being accepted: browsers open several connections at once."""

    def __init__(
        self, host: str, port: int, folder: Path, clock: Callable[[], float] = monotonic
    ) -> None:
        self.token = "" if host in LOOPBACK else secrets.token_urlsafe(16)
        self.host = host
        self.page = resources.files("app.monitor").joinpath("live.html").read_text(encoding="utf-8")
        self.address_family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._clock = clock
        self._folder = folder.absolute()  # which the working directory may be, and go with it
        self._visits = threading.BoundedSemaphore(MOST_VISITS)
        self._looking = threading.Lock()
        self._look_again_s = 0.0
        self._looked_s = clock()
        self._state: dict[str, object] = {"name": self._folder.name, **CONNECTING}
        super().__init__((host, port), _Visit)

    @property
    def url(self) -> str:
        """Address to open; of a server at all addresses, the one that other machines reach."""
        query = f"?token={self.token}" if self.token else ""
        host = own_address() if self.host in {"0.0.0.0", "::"} else self.host  # noqa: S104
        host = f"[{host}]" if ":" in host else host
        return f"http://{host}:{self.server_address[1]}/{query}"

    def state_text(self) -> str:
        """Return the state of the campaign as JSON, read again after a pause; grey if it is old."""
        # Many visitors share one reading: the lock lets one of them read, the others get at once
        # what was read before. Its age counts from the beginning of the reading.
        if self._looking.acquire(blocking=False):
            try:
                began_s = self._clock()
                if began_s >= self._look_again_s:
                    self._state, self._looked_s = live_state(self._folder), began_s
                    pause_s = PAUSE_PER_LOOK * (self._clock() - began_s)
                    pause_s = min(max(LOOK_EVERY_S, pause_s), LONGEST_PAUSE_S)
                    self._look_again_s = self._clock() + pause_s
            finally:
                self._looking.release()
        age_s, state = self._clock() - self._looked_s, self._state
        if age_s > STALE_S:
            state = state | {"colour": "grey", "state": f"last read {age_s:.0f} s ago"}
        return json.dumps(state, allow_nan=False)

    @override
    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer in a thread of its own; send away who comes while all of them are busy."""
        if not self._visits.acquire(timeout=FULL_HOUSE_S):
            self.shutdown_request(request)
            return
        try:
            super().process_request(request, client_address)
        except BaseException:  # no thread was started that would end the visit
            self._visits.release()
            raise

    @override
    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """Answer, and let the next visitor in."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._visits.release()

    @override
    def handle_error(self, request: object, client_address: object) -> None:
        """Print nothing about a visitor who has left: a traceback would hide the page's address."""


def own_address() -> str:
    """Return this machine's address in its network, or its name where it has no network."""
    # connecting a datagram socket sends nothing, but makes the system choose the outgoing address
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))  # an address reserved for documentation
        except OSError:
            return socket.gethostname()
        return str(probe.getsockname()[0])


class _Visit(BaseHTTPRequestHandler):
    server: LiveServer
    timeout = SLOW_READER_S
    server_version, sys_version = "pkmcal", ""

    def do_GET(self) -> None:
        """Send the page or the state to a visitor who may have it."""
        address = urlsplit(self.path)
        if address.path == "/favicon.ico":  # browsers ask for it without the token
            self._send(200, "image/svg+xml", ICON)
        elif not self._is_welcome(parse_qs(address.query).get("token", [""])[0]):
            text = "the address that `pkmcal watch` printed has a token: use it whole\n"
            self._send(403, "text/plain", text)
        elif address.path == "/":
            nonce = secrets.token_urlsafe(16)
            allowed = f"script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; connect-src 'self'"
            allowed += "; img-src 'self'"
            self._send(200, "text/html", self.server.page.replace("NONCE", nonce), allowed)
        elif address.path == "/state":
            self._send(200, "application/json", self.server.state_text())
        else:
            self._send(404, "text/plain", "there is only /\n")

    def _is_welcome(self, token: str) -> bool:
        """Return whether the token is right; on loopback, whether the host is loopback's name."""
        if self.server.token:
            return secrets.compare_digest(token.encode(), self.server.token.encode())
        return _NAMES_OF_LOOPBACK.fullmatch(self.headers.get("Host", "")) is not None

    def _send(self, code: int, kind: str, text: str, allowed: str = "") -> None:
        policy = f"default-src 'none'; base-uri 'none'; frame-ancestors 'none'; {allowed}"
        headers = {
            "Content-Type": f"{kind}; charset=utf-8",
            "Content-Length": str(len(text.encode())),
            "Content-Security-Policy": policy,
            "Cache-Control": "no-store",
            "X-Content-Type-Options": "nosniff",
            "Referrer-Policy": "no-referrer",
        }
        self.send_response(code)
        for name, value in headers.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(text.encode())

    @override
    def log_message(self, format: str, *arguments: object) -> None:
        """Print no line for a visit."""
