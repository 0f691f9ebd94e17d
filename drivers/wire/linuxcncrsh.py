"""The grammar of linuxcncrsh, LinuxCNC's line protocol: requests out, answers in, no I/O.

Facts that shape it, of LinuxCNC 2.9 and of the rewrite that will be 2.10:

- A request is one line of at most 255 bytes. 2.9 has no bounds check: a longer one crashes it.
- Answers end in CR LF, in LF CR, or in both twice. So lines are cut at either sign, and empty ones
  are dropped.
- Once `verbose` is on, `set` is answered by `SET WORD ACK` or `SET WORD NAK`. `get` is answered by
  its word and values.
- Newer versions say `error: …` on a line of its own before a NAK, and also before an ACK that is
  none because its time ran out.
"""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass

from drivers.errors import WireError
from drivers.wire.framing import LineFramer

PROTOCOL = "1.1"
LONGEST_REQUEST = 255
"""Bytes, the line feed among them."""
LONGEST_ANSWER = 1024
"""Bytes, far above what 2.9 can say (255), and enough for a newer one's path of an INI file."""

_REQUEST = re.compile(r"[ -~]+")
_ANSWER_WORD = re.compile(r"[A-Z][A-Z0-9_]*")
_NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,3})?")
"""As C's printf writes it; Python also takes `1_0` and the digits of other scripts."""


@dataclass(frozen=True, slots=True)
class LinuxcncGreeting:
    """The answer to `hello`: the server's name and protocol version if it accepts."""

    accepted: bool
    name: str
    version: str
    line: str


@dataclass(frozen=True, slots=True)
class Verdict:
    """`SET WORD ACK` and its like. `word` is empty where a newer version leaves it out."""

    verb: str
    word: str
    accepted: bool
    line: str


@dataclass(frozen=True, slots=True)
class Value:
    """The answer to `get`: its word, and the rest of the line."""

    word: str
    text: str
    line: str


@dataclass(frozen=True, slots=True)
class Remark:
    """A line that answers nothing: a newer version's `error:`, an echo, a message's second line."""

    line: str


Message = LinuxcncGreeting | Verdict | Value | Remark


def answers() -> Callable[[bytes], list[Message]]:
    """Messages from bytes, in any pieces; raises only `WireError`."""
    lines = LineFramer(LONGEST_ANSWER)

    def feed(data: bytes) -> list[Message]:
        read = map(read_message, lines.feed(data.replace(b"\r", b"\n")))
        return [message for message in read if message is not None]

    return feed


def encode(request: str) -> bytes:
    """Write a request as its line; raises `WireError` for one that would not arrive as it is.

    The error tells only the first word: others can be passwords.
    """
    verb = request.partition(" ")[0]
    if not _REQUEST.fullmatch(request):
        raise WireError(
            f"{verb!r:.20} with what follows it cannot be sent to LinuxCNC",
            remedy="use printable ASCII, in one line",
        )
    line = request.encode("ascii") + b"\n"
    if len(line) > LONGEST_REQUEST:
        raise WireError(
            f"a '{verb:.20}' of {len(line)} bytes, at most {LONGEST_REQUEST} are safe",
            remedy="shorten the password or the command",
        )
    return line


def read_message(line: bytes) -> Message | None:
    """Read one line, None for white space; raises `WireError` when it is none of this protocol's.

    White space is Unicode's: what looks empty after decoding has no word to begin with.
    """
    if len(line) > LONGEST_ANSWER:
        raise WireError(f"LinuxCNC answers more than {LONGEST_ANSWER} bytes in one line")
    text = line.decode("utf-8", errors="replace").replace("\t", " ").strip()
    if not text.isprintable():
        raise WireError(f"LinuxCNC answers what is no text: {text!r:.60}")
    words = text.split()
    if not words:
        return None
    if words[0] == "HELLO":
        return _greeting(words, text)
    if words[-1] in {"ACK", "NAK"} and len(words) <= 3 and all(map(_ANSWER_WORD.fullmatch, words)):
        word = words[1] if len(words) == 3 else ""
        return Verdict(words[0], word, words[-1] == "ACK", text)
    if _ANSWER_WORD.fullmatch(words[0]):
        return Value(words[0], text[len(words[0]) :].strip(), text)
    return Remark(text)


def read_numbers(value: Value) -> tuple[float, ...]:
    """Read an answer's numbers; raises `WireError`, also for one that is not finite."""
    words = value.text.split()
    if not all(map(_NUMBER.fullmatch, words)):
        raise WireError(f"LinuxCNC answers no numbers: {value.line!r:.80}")
    numbers = tuple(map(float, words))
    if not all(map(math.isfinite, numbers)):
        raise WireError(f"LinuxCNC answers a number that is not finite: {value.line!r:.80}")
    return numbers


def _greeting(words: list[str], text: str) -> LinuxcncGreeting:
    if words[1:] == ["NAK"]:
        return LinuxcncGreeting(accepted=False, name="", version="", line=text)
    if len(words) != 4 or words[1] != "ACK":
        raise WireError(f"a greeting that is none of linuxcncrsh: {text!r:.80}")
    return LinuxcncGreeting(accepted=True, name=words[2], version=words[3], line=text)
