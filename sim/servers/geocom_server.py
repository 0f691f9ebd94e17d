"""The simulated total station's side of GeoCOM (docs/geocom.md): one connection, no socket."""

from collections import deque
from collections.abc import Callable

from typing_extensions import override

from drivers.errors import WireError
from drivers.wire import geocom
from drivers.wire.geocom_constants import Result
from sim.servers.geocom_instrument import GeocomOutcome, Later, Value
from sim.servers.geocom_station import GeocomStation
from sim.servers.peers import ServedSession

MOST_WAITING = 100
"""Requests that are kept while one is under way; what comes above is lost, as in a full buffer."""


class GeocomSession(ServedSession):
    """Answers one client, one call after another; settings are the station's and stay with it."""

    def __init__(self, station: GeocomStation, send: Callable[[bytes], None]) -> None:
        self._station = station
        self._send = send
        self._lines = geocom.line_framer()
        self._waiting: deque[geocom.GeocomRequest] = deque()
        self._pending: tuple[geocom.GeocomRequest, Later] | None = None
        """The one call that is under way."""

    @override
    def received(self, data: bytes, now_s: float) -> None:
        """Obey every line that these bytes complete; what takes time is answered by `advance`."""
        for line in self._lines.feed(data):
            if line:
                self._take(line, now_s)
        self.advance(now_s)

    @override
    def advance(self, now_s: float) -> None:
        """End what is due, and go on with what waits behind it."""
        self._station.advance(now_s)
        if self._pending is not None and now_s >= self._pending[1].due_s:
            (request, later), self._pending = self._pending, None
            self._answer(request, later.finish(now_s))
        while self._waiting and self._pending is None:
            self._begin(self._waiting.popleft(), now_s)

    @override
    def next_due_s(self) -> float | None:
        """Time of the next thing that happens by itself."""
        times = [self._station.next_due_s(), self._pending[1].due_s if self._pending else None]
        return min((time_s for time_s in times if time_s is not None), default=None)

    @override
    def closed(self, now_s: float) -> None:
        """Forget what was under way; the telescope stays where it looks."""
        self._pending = None
        self._waiting.clear()

    def _take(self, line: bytes, now_s: float) -> None:
        try:
            request = geocom.decode_request(line)
        except geocom.BadChecksum as error:
            self._say(geocom.GeocomReply(Result.COM_SERVER_CHECKSUM, error.transaction, Result.OK))
        except WireError:
            self._say(geocom.GeocomReply(Result.COM_WRONG_FORMAT, 0, Result.OK))
        else:
            if request is None:
                self._abort()
            elif len(self._waiting) < MOST_WAITING:
                self._waiting.append(request)
                self.advance(now_s)

    def _abort(self) -> None:
        """End what is under way with its refusal, then confirm."""
        if self._pending is not None:
            (request, _), self._pending = self._pending, None
            self._answer(request, GeocomOutcome(Result.ABORTED))
        self._send(geocom.ABORTED + geocom.TERMINATOR)

    def _begin(self, request: geocom.GeocomRequest, now_s: float) -> None:
        try:
            outcome = self._station.obey(request.rpc, request.parameters, now_s)
        except WireError:
            self._fail(request, Result.COM_CANNOT_DECODE_REQUEST)
            return
        if outcome is None:
            self._fail(request, Result.COM_UNKNOWN_PROCEDURE)
        elif isinstance(outcome, Later):
            self._pending = request, outcome
        else:
            self._answer(request, outcome)

    def _answer(self, request: geocom.GeocomRequest, outcome: GeocomOutcome) -> None:
        words = tuple(self._word(value) for value in outcome.values)
        reply = geocom.GeocomReply(
            Result.OK, request.transaction, outcome.result, words, request.checked
        )
        self._say(reply)

    def _fail(self, request: geocom.GeocomRequest, communication: Result) -> None:
        self._say(
            geocom.GeocomReply(
                communication, request.transaction, Result.OK, checked=request.checked
            )
        )

    def _say(self, reply: geocom.GeocomReply) -> None:
        self._send(geocom.encode_reply(reply))

    def _word(self, value: Value) -> str:
        if isinstance(value, str):
            return geocom.string_word(value)
        if isinstance(value, int):
            return str(int(value))
        return geocom.number_word(value, self._station.instrument.decimals)
