"""Grammar of GeoCOM: requests and replies as lines, their parameters as words."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from drivers.errors import WireError
from drivers.wire.framing import LineFramer, messages
from drivers.wire.geocom_constants import procedure_text, result_text

DECIMALS = 15
"""Decimals with which a client writes a number, unless it says otherwise."""
LINE_BYTES = 1024
"""The longest line; carriage return counts. Nothing that measuring needs comes near it."""
TERMINATOR = b"\r\n"
ABORT = b"c"
"""A single character that stops a motion; answered by `ABORTED`."""
ABORTED = b"?"
PROCEDURES_KEPT = 100
_SHOWN_BYTES = 80
_CRC_POLYNOMIAL = 0xA001
_NUMBER = rb"0|[1-9][0-9]{0,8}"
_HEAD = rb"(?P<transaction>%b)(?:,(?P<crc>[0-9]{1,5}))?" % _NUMBER
_REQUEST = re.compile(rb"%%R1Q,(?P<rpc>%b)(?:,%b)?:(?P<rest>[ -~]*)" % (_NUMBER, _HEAD))
_REPLY = re.compile(
    rb"%%R1P,(?P<communication>%b),%b:(?P<result>%b)(?:,(?P<rest>[ -~]*))?"
    % (_NUMBER, _HEAD, _NUMBER)
)
_PARAMETER = re.compile(r'(?:"(?:[^"\\]|\\.)*"|[^",])*')
_STRING = re.compile(r'"(?:[^"\\]|\\.)*"')
_ESCAPE = re.compile(r"\\(?:[xX](?P<byte>[0-9a-fA-F]{2})|(?P<sign>.))")
_WHOLE = re.compile(r"-?[0-9]{1,18}")
_DECIMAL = re.compile(r"[+-]?[0-9]{1,18}(\.[0-9]{0,30})?([eE][+-]?[0-9]{1,2})?")


def words_of(*values: float | str, decimals: int = DECIMALS) -> tuple[str, ...]:
    """Write whole numbers, numbers with a point, and strings, as a driver sends them.

    A string is sent as it is: what an instrument has escaped in a name, it knows again. Raises
    `WireError` for one that would end before its end.
    """
    return tuple(_word(value, decimals) for value in values)


def _word(value: float | str, decimals: int) -> str:
    if isinstance(value, str):
        word = f'"{value}"'
        if not _STRING.fullmatch(word):
            raise WireError(f"{value!r:.80} cannot be sent as a string")
        return word
    if isinstance(value, int):
        return f"{value:d}"
    return number_word(value, decimals)


def number_word(value: float, digits: int) -> str:
    """Write a number with a point and at most so many decimals, as an instrument does."""
    text = f"{value:.{max(digits, 1)}f}".rstrip("0")
    return f"{text}0" if text.endswith(".") else text


def string_word(text: str) -> str:
    """Write a string in quotes; what is not printable ASCII, as its byte in hexadecimal."""
    return '"' + "".join(map(_escaped, text.encode("latin-1", "replace"))) + '"'


def _escaped(byte: int) -> str:
    sign = chr(byte)
    if sign in '\\"%~':
        return f"\\{sign}"
    return sign if " " <= sign <= "~" else f"\\x{byte:02X}"


def parse_string(word: str) -> str:
    """Read a string in quotes; raises `WireError`."""
    if not _STRING.fullmatch(word):
        raise WireError(f"{word!r:.80} is not a string in quotes")
    return _ESCAPE.sub(_unescaped, word[1:-1])


def _unescaped(found: re.Match[str]) -> str:
    return found["sign"] if found["byte"] is None else chr(int(found["byte"], 16))


def parse_whole(word: str) -> int:
    """Read a whole number; raises `WireError`."""
    if not _WHOLE.fullmatch(word):
        raise WireError(f"{word!r:.80} is not a whole number")
    return int(word)


def parse_number(word: str) -> float:
    """Read a number, with or without a point; raises `WireError`."""
    if not _DECIMAL.fullmatch(word):
        raise WireError(f"{word!r:.80} is not a number")
    return float(word)


def parse_words(parameters: Sequence[str], count: int) -> Sequence[str]:
    """Insist on so many parameters; raises `WireError`."""
    if len(parameters) != count:
        raise WireError(f"{len(parameters)} parameters where {count} are needed")
    return parameters


@dataclass(frozen=True, slots=True)
class GeocomRequest:
    """A call of a remote procedure; its parameters are words as on the wire.

    `checked` asks for a checksum, in the answer too.
    """

    rpc: int
    transaction: int = 0
    parameters: tuple[str, ...] = ()
    checked: bool = False


@dataclass(frozen=True, slots=True)
class GeocomReply:
    """Reply to a request: whether it could be carried, what came of it, and the values.

    `line` is it as it came, without its end.
    """

    communication: int
    transaction: int
    result: int
    parameters: tuple[str, ...] = ()
    checked: bool = False
    line: str = field(default="", compare=False)

    @property
    def code(self) -> int:
        """What went wrong, on the way or in the instrument; 0 when nothing did."""
        return self.communication or self.result


class BadChecksum(WireError):
    """A request that was damaged on the way; `transaction` is its number as it came."""

    def __init__(self, problem: str, transaction: int) -> None:
        super().__init__(problem)
        self.transaction = transaction


def crc16(text: bytes) -> int:
    """CRC-16/ARC: polynomial 0x8005 reflected, start 0."""
    crc = 0
    for byte in text:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (_CRC_POLYNOMIAL if crc & 1 else 0)
    return crc


def encode_request(request: GeocomRequest) -> bytes:
    """Write a request as a line with its end; raises `WireError` for what cannot be sent."""
    body = ",".join(request.parameters)
    head = f"%R1Q,{request.rpc},{request.transaction}"
    return _line(head, f":{body}", checked=request.checked)


def encode_reply(reply: GeocomReply) -> bytes:
    """Write a reply as a line with its end; raises `WireError` for what cannot be sent."""
    body = ",".join((str(reply.result), *reply.parameters))
    head = f"%R1P,{reply.communication},{reply.transaction}"
    return _line(head, f":{body}", checked=reply.checked)


def decode_request(line: bytes) -> GeocomRequest | None:
    """Read a line without its end, None for `ABORT`; raises `WireError`, also `BadChecksum`."""
    if line == ABORT:
        return None
    found = _matched(_REQUEST, line)
    transaction = int(found["transaction"] or 0)
    _check(found, line, transaction)
    parameters = _split(found["rest"] or None)
    return GeocomRequest(
        int(found["rpc"]), transaction, parameters, checked=found["crc"] is not None
    )


def decode_reply(line: bytes) -> GeocomReply:
    """Read a line without its end; raises `WireError`, `BadChecksum` among them."""
    found = _matched(_REPLY, line)
    transaction = int(found["transaction"])
    _check(found, line, transaction)
    return GeocomReply(
        int(found["communication"]),
        transaction,
        int(found["result"]),
        _split(found["rest"]),
        checked=found["crc"] is not None,
        line=line.decode("ascii"),
    )


def replies() -> Callable[[bytes], list[GeocomReply]]:
    """Replies from bytes, in any pieces; empty lines and answers to an abort are passed over.

    Raises only `WireError`.
    """
    lines = line_framer()
    return messages(
        lambda data: [each for each in lines.feed(data) if each != ABORTED], decode_reply
    )


class Conversation:
    """Lines of both directions for people; a reply names the procedure that its number belongs to.

    Raises `WireError`.
    """

    def __init__(self) -> None:
        self._procedures: dict[int, str] = {}

    def describe_request(self, line: bytes) -> str:
        """Say a line to the instrument."""
        request = decode_request(line)
        if request is None:
            return "abort the motion"
        while len(self._procedures) >= PROCEDURES_KEPT:
            del self._procedures[next(iter(self._procedures))]
        self._procedures[request.transaction] = name = procedure_text(request.rpc)
        return f"{name}({', '.join(request.parameters)}), question {request.transaction}"

    def describe_reply(self, line: bytes) -> str:
        """Say a line from the instrument."""
        if line == ABORTED:
            return "the motion is aborted"
        reply = decode_reply(line)
        name = self._procedures.pop(reply.transaction, "nothing that was asked")
        said = result_text(reply.code) if reply.code else f"({', '.join(reply.parameters)})"
        return f"answer {reply.transaction} to {name}: {said}"


def line_framer() -> LineFramer:
    """Cut a stream into lines of GeoCOM."""
    return LineFramer(LINE_BYTES)


def _line(head: str, tail: str, *, checked: bool) -> bytes:
    text = head + tail
    if not (text.isascii() and text.isprintable()):
        raise WireError(f"{text!r:.80} cannot be sent: it is not printable ASCII")
    plain = text.encode("ascii")
    if checked:
        plain = f"{head},{crc16(plain)}{tail}".encode("ascii")
    if len(plain) >= LINE_BYTES:
        raise WireError(f"a line of {len(plain)} bytes cannot be sent, the limit is {LINE_BYTES}")
    return plain + TERMINATOR


def _matched(form: re.Pattern[bytes], line: bytes) -> re.Match[bytes]:
    found = form.fullmatch(line) if len(line) <= LINE_BYTES else None
    if found is None:
        raise WireError(f"not a line of GeoCOM: {line[:_SHOWN_BYTES]!r}")
    return found


def _check(found: re.Match[bytes], line: bytes, transaction: int) -> None:
    """Compare the checksum, if there is one, with that of the line without it."""
    if found["crc"] is None:
        return
    without = line[: found.start("crc") - 1] + line[found.end("crc") :]
    if crc16(without) != int(found["crc"]):
        raise BadChecksum(f"the checksum does not fit: {line[:_SHOWN_BYTES]!r}", transaction)


def _split(text: bytes | None) -> tuple[str, ...]:
    """Cut at the commas that are in no string."""
    if text is None:
        return ()
    rest, words = text.decode("ascii"), []
    while True:
        found = _PARAMETER.match(rest)
        assert found is not None  # it matches the empty word too
        words.append(found[0])
        rest = rest[found.end() :]
        if not rest:
            return tuple(words)
        if not rest.startswith(","):
            raise WireError(f"a string without its end: {text[:_SHOWN_BYTES]!r}")
        rest = rest[1:]
