"""The simulated total station's side of GeoCOM (docs/geocom.md): one connection, no socket."""

from collections.abc import Callable

from typing_extensions import override

from drivers.errors import WireError
from drivers.wire import geocom
from drivers.wire.geocom_constants import Result
from sim.servers.geocom_instrument import GeocomOutcome, Obeyed, Value
from sim.servers.geocom_station import GeocomStation
from sim.servers.queueing import QueueingSession


class GeocomSession(QueueingSession[geocom.GeocomRequest, GeocomOutcome]):
    """Answers one client, one call after another; settings are the station's and stay with it."""

    def __init__(self, station: GeocomStation, send: Callable[[bytes], None]) -> None:
        super().__init__(geocom.line_framer(), station.advance, station.next_due_s)
        self._station = station
        self._send = send

    @override
    def _read(self, line: bytes) -> geocom.GeocomRequest | None:
        try:
            request = geocom.decode_request(line)
        except geocom.BadChecksum as error:
            self._say(geocom.GeocomReply(Result.COM_SERVER_CHECKSUM, error.transaction, Result.OK))
        except WireError:
            self._say(geocom.GeocomReply(Result.COM_WRONG_FORMAT, 0, Result.OK))
        else:
            if request is None:
                self._abort()
            return request
        return None

    def _abort(self) -> None:
        """End what is under way with its refusal, then confirm."""
        if self._pending is not None:
            (request, _), self._pending = self._pending, None
            self._answer(request, GeocomOutcome(Result.ABORTED))
        self._send(geocom.ABORTED + geocom.TERMINATOR)

    @override
    def _obey(self, request: geocom.GeocomRequest, now_s: float) -> Obeyed:
        try:
            outcome = self._station.obey(request.rpc, request.parameters, now_s)
        except WireError:
            return GeocomOutcome(communication=Result.COM_CANNOT_DECODE_REQUEST)
        return outcome or GeocomOutcome(communication=Result.COM_UNKNOWN_PROCEDURE)

    @override
    def _answer(self, request: geocom.GeocomRequest, outcome: GeocomOutcome) -> None:
        words = tuple(self._word(value) for value in outcome.values)
        reply = geocom.GeocomReply(
            outcome.communication, request.transaction, outcome.result, words, request.checked
        )
        self._say(reply)

    def _say(self, reply: geocom.GeocomReply) -> None:
        self._send(geocom.encode_reply(reply))

    def _word(self, value: Value) -> str:
        if isinstance(value, str):
            return geocom.string_word(value)
        if isinstance(value, int):
            return str(int(value))
        return geocom.number_word(value, self._station.instrument.decimals)
