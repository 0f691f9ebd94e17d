"""The connection that geocompy talks through: a link of ours, which always ends at a deadline.

geocompy's own connections wait for ever when the instrument closes a socket, and read a late answer
as the answer to the next question. Here a question ends with its own answer or at its deadline, and
anything else closes the connection.
"""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import NoReturn

from geocompy.communication import Connection

from drivers.errors import DriverError
from drivers.link import Link, never
from drivers.transport import Transport
from drivers.wire.geocom import (
    TERMINATOR,
    Abort,
    Reply,
    ReplyFramer,
    decode_request,
    encode_reply,
)
from drivers.wire.geocom_constants import procedure_text

ENCODING = "ascii"


class GeocomConnection(Connection):
    """Connection with one question at a time; a failure is kept in `failure`, and closes it.

    geocompy makes a return code of every error that it is given, so whoever asks by it has to look
    at `failure` afterwards. A reply to another transaction is stale (after a fault it can sit in a
    serial line's buffer): it is never read as the answer.
    """

    def __init__(
        self,
        transport: Transport,
        *,
        clock_s: Callable[[], float],
        within_s: float,
        cancelled: Callable[[], bool] = never,
    ) -> None:
        self._transport = transport
        self._within_s = within_s
        self._asked = -1
        self.failure: DriverError | None = None
        """Error that broke the connection; None while it is whole."""
        self._link: Link[Reply] = Link(
            transport,
            ReplyFramer(),
            clock_s=clock_s,
            is_event=lambda reply: reply.transaction != self._asked,
            cancelled=cancelled,
        )

    @property
    def name(self) -> str:
        """Name of the instrument's place, for messages."""
        return self._link.name

    @contextmanager
    def patience(self, within_s: float) -> Iterator[None]:
        """Give the questions inside the block so many seconds each."""
        usual_s, self._within_s = self._within_s, within_s
        try:
            yield
        finally:
            self._within_s = usual_s

    def is_open(self) -> bool:
        """Whether a question can be asked, without sending anything."""
        return self._link.is_open

    def exchange(self, cmd: str) -> str:
        """Ask, and return the answer's line; raises `ConnectionError` and keeps its reason."""
        with self._kept_failure():
            request = decode_request(cmd.encode(ENCODING))
            if isinstance(request, Abort):
                _refuse("an abort has no number by which its answer is known")
            self._asked = request.transaction
            reply = self._link.ask(
                cmd.encode(ENCODING) + TERMINATOR,
                answers=lambda reply: reply.transaction == self._asked,
                within_s=self._within_s,
                what=procedure_text(request.rpc),
            )
        return encode_reply(reply).removesuffix(TERMINATOR).decode(ENCODING)

    def exchange_binary(self, data: bytes) -> bytes:
        """Ask like `exchange`."""
        return self.exchange(data.decode(ENCODING)).encode(ENCODING)

    def send(self, message: str) -> None:
        """Send what has no answer: an empty line, which wakes the instrument."""
        self.send_binary(message.encode(ENCODING))

    def send_binary(self, data: bytes) -> None:
        """Send what has no answer; raises `ConnectionError` and keeps its reason."""
        with self._kept_failure():
            if data.strip():
                _refuse("what has an answer is asked by `exchange`")
            self._transport.send(data.rstrip(TERMINATOR) + TERMINATOR, self._within_s)

    def receive(self) -> str:
        """Refuse: nothing is read that was not asked for."""
        _refuse("nothing is read that was not asked for")

    def receive_binary(self) -> bytes:
        """Refuse: nothing is read that was not asked for."""
        _refuse("nothing is read that was not asked for")

    def reset(self) -> None:
        """Refuse: after a fault the instrument has to be prepared anew."""
        _refuse("after a fault the tracker is to be reconnected")

    def close(self) -> None:
        """Close; a second time does nothing."""
        self._link.close()

    @contextmanager
    def _kept_failure(self) -> Iterator[None]:
        try:
            yield
        except DriverError as error:
            self.close()
            self.failure = self.failure or error
            raise ConnectionError(str(error)) from error


def _refuse(reason: str) -> NoReturn:
    raise ConnectionError(reason)
