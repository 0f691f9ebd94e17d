"""Lines with a number, a verb and a checksum: the common part of robotline and pointline.

Plain Python, to be copied beside either server. A server is a `Session` for each connection, whose
`VERBS` name for each verb the kinds of its words and the method that answers it.
"""

import math
import re
import socketserver
from urllib.parse import quote, unquote

NUMBERED = rb">([1-9][0-9]{0,8})"
LINE = re.compile(rb"(" + NUMBERED + rb"((?: [!-~]+)*)) \*([0-9A-F]{4})")
NUMBER = re.compile(r"-?[0-9]+\.[0-9]+([eE][+-]?[0-9]{1,3})?")
PLAIN = "".join(chr(code) for code in range(33, 127) if chr(code) != "%")


class Refused(Exception):
    """The device says no: a code of the page, and a text for people."""

    def __init__(self, code, text=""):
        super().__init__(code, text)
        self.code, self.text = code, text


def checksum(text):
    """Compute the CRC-16/CCITT-FALSE of bytes."""
    crc = 0xFFFF
    for byte in text:
        crc = crc ^ (byte << 8)
        for _ in range(8):
            crc = crc << 1
            if crc > 0xFFFF:
                crc = (crc ^ 0x1021) & 0xFFFF
    return b"%04X" % crc


def read_number(word):
    """Read a number with a decimal point."""
    if not NUMBER.fullmatch(word) or math.isinf(float(word)):
        raise Refused("ARGUMENT", f"{word} is not a number like -12.5")
    return float(word)


def read_whole(word):
    """Read a whole number."""
    if not re.fullmatch(r"0|[1-9][0-9]{0,8}", word):
        raise Refused("ARGUMENT", f"{word} is not a whole number")
    return int(word)


def read_name(word):
    """Read a text that is written as one word."""
    return "" if word == "-" else unquote(word)


READERS = {"d": read_number, "w": read_whole, "n": read_name, "t": str}


def written(value):
    """Write a flag, a whole number, a number with all its digits, or a text as one word."""
    if isinstance(value, bool):
        return str(int(value))
    if isinstance(value, float):
        text = repr(value)
        return text if "." in text else text.replace("e", ".0e")
    if isinstance(value, str):
        return "%2D" if value == "-" else quote(value, safe=PLAIN) or "-"
    return str(value)


class Session:
    """One connection; `VERBS` maps a verb to the kinds of its words and the method's name.

    Kinds are `d` number, `w` whole number, `n` name, `t` a word as it stands.
    """

    LONGEST = 255
    VERBS = {}

    def lost(self):
        """Do what has to be done when the connection has ended."""

    def answer(self, line):
        """Answer one line without its line feed, in bytes; None: keep silent."""
        sound = LINE.fullmatch(line)
        if len(line) >= self.LONGEST or sound is None or checksum(sound[1]) != sound[4]:
            head = re.match(NUMBERED + rb" ", line)
            return head and reply(head[1], "?", "NO", "CHECKSUM")
        verb, *words = sound[3].decode().split() or [""]
        if verb not in self.VERBS:
            return reply(sound[2], "?", "NO", "VERB")
        try:
            told = self.obey(verb, words)
        except Refused as no:
            return reply(sound[2], verb, "NO", no.code, *no.text.split())
        return reply(sound[2], verb, "OK", *map(written, told))

    def obey(self, verb, words):
        """Return the values of the answer; raises `Refused`."""
        kinds, method = self.VERBS[verb]
        if len(words) != len(kinds):
            raise Refused("ARGUMENT", f"{len(words)} words, {len(kinds)} are needed")
        values = [READERS[kind](word) for kind, word in zip(kinds, words, strict=True)]
        return getattr(self, method)(*values) or ()


def reply(number, *words):
    """Return a line of the answer, with its checksum and line feed."""
    text = b"<" + number + b" " + " ".join(words).encode("ascii", "replace")
    return text + b" *" + checksum(text) + b"\n"


def serve(host, port, new_session):
    """Serve until the program ends; each connection is answered by itself."""

    class Connection(socketserver.BaseRequestHandler):
        def handle(self):
            session, waiting = new_session(), b""
            try:
                while data := self.request.recv(4096):
                    *lines, waiting = (waiting + data).split(b"\n")
                    waiting = waiting[: session.LONGEST]  # too long already: never taken
                    for line in lines:
                        said = line.strip(b"\r") and session.answer(line.removesuffix(b"\r"))
                        if said:
                            self.request.sendall(said)
            except OSError:
                pass  # the client has gone
            finally:
                session.lost()

    class Server(socketserver.ThreadingTCPServer):
        allow_reuse_address = daemon_threads = True

    with Server((host, port), Connection) as server:
        print(f"listening on port {server.server_address[1]}", flush=True)
        server.serve_forever()
