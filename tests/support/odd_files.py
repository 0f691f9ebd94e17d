"""Odd files: what a disk, an editor or a stranger can make of a file, and things that are no files.

An `Oddity` puts something in a file's place. Those that are drawn change the file's bytes, the
others are the same for every file of a kind.
"""

import json
import os
import random
import socket
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

KIB, MIB = 1024, 1024**2
SPARSE_BYTES = 50 * 1024 * MIB
"""Of a file that takes no place on the disk."""


@dataclass(frozen=True, slots=True)
class Oddity:
    """Something odd with its name: `put` makes it stand in a file's place."""

    name: str
    put: Callable[[Path], None]


TOKENS: Sequence[bytes] = (
    *(b"\x00", b"\xff", b"\xef\xbb\xbf", b"\xed\xa0\x80", b"\x1b[2J\x1b[31m", b"\x07", b"\x7f"),
    *("\u202e\u2066".encode(), "\u2028".encode(), "\x85".encode(), "٣".encode(), "−1".encode()),
    *(b"&a ", b"*a", b"<<: *a", b"!!python/object:os.system ", b"!!binary ", b"!!set ", b"!x "),
    *(b"? ", b"- ", b"[", b"]", b"{", b"}", b"|", b">", b"%YAML 9.9", b"---", b"...", b"#", b"\t"),
    *(b"'", b'"', b'""', b"\\", b":", b": ", b",", b";", b"\n", b"\r", b"\r\n", b"=1+1", b"@x"),
    *(b".nan", b".inf", b"-.inf", b"nan", b"inf", b"1e400", b"-1e400", b"1e-400", b"1_000", b"0x1"),
    *(b"9" * 30, b"9" * 5000, b"-" + b"9" * 400, b"0o7", b"010", b"1:30", b"2026-01-01", b"yes"),
    *(b"null", b"~", b"true", b"1,5", b"1.5.2", b"+-1", b"0", b"-0.0", b"5e-324", b"1e308"),
    *(b"sim://" + b"x" * 3000, b"sim://a\x00b", b"sim://../../etc", b"serial:///dev/null?baud=x"),
    *(b"x" * 200, b" " * 2000, b"A" * (64 * KIB)),
)


def drawn(data: bytes, others: Sequence[bytes], rng: random.Random) -> Oddity:
    """One to three changes of a file's bytes, put one after the other."""
    names, changed = [], data
    for _ in range(rng.choice((1, 1, 1, 2, 3))):
        change = rng.choice(CHANGES)
        names.append(change.__name__.removeprefix("_"))
        changed = change(changed, others, rng)
    return of_bytes("+".join(names), changed)


def of_bytes(name: str, data: bytes) -> Oddity:
    """A file of these bytes."""
    return made(name, lambda: data)


def made(name: str, data: Callable[[], bytes]) -> Oddity:
    """A file of bytes that are made only when it is put there: they may be many."""

    def put(path: Path) -> None:
        path.write_bytes(data())

    return Oddity(name, put)


def _spot(data: bytes, rng: random.Random) -> int:
    return rng.randrange(len(data) + 1)


def _span(data: bytes, rng: random.Random) -> tuple[int, int]:
    first = _spot(data, rng)
    return first, min(len(data), first + rng.choice((1, 2, 5, 20, 200)))


def _bytes_flipped(data: bytes, _others: Sequence[bytes], rng: random.Random) -> bytes:
    flipped = bytearray(data)
    for _ in range(rng.choice((1, 1, 4, 30))):
        if flipped:
            flipped[rng.randrange(len(flipped))] = rng.randrange(256)
    return bytes(flipped)


def _token_inserted(data: bytes, _others: Sequence[bytes], rng: random.Random) -> bytes:
    spot = _spot(data, rng)
    return data[:spot] + rng.choice(TOKENS) + data[spot:]


def _value_replaced(data: bytes, _others: Sequence[bytes], rng: random.Random) -> bytes:
    """Something odd in place of what stands after a colon or comma."""
    marks = [at for at, sign in enumerate(data) if sign in b":,"]
    if not marks:
        return rng.choice(TOKENS)
    start = rng.choice(marks) + 1
    end = next((at for at in range(start, len(data)) if data[at] in b",\n]}"), len(data))
    return data[:start] + b" " + rng.choice(TOKENS) + data[end:]


def _cut(data: bytes, _others: Sequence[bytes], rng: random.Random) -> bytes:
    return data[: _spot(data, rng)]


def _part_lost(data: bytes, _others: Sequence[bytes], rng: random.Random) -> bytes:
    first, last = _span(data, rng)
    return data[:first] + data[last:]


def _part_repeated(data: bytes, _others: Sequence[bytes], rng: random.Random) -> bytes:
    first, last = _span(data, rng)
    return data[:last] + data[first:last] * rng.choice((1, 3, 50)) + data[last:]


def _lines_mixed(data: bytes, _others: Sequence[bytes], rng: random.Random) -> bytes:
    lines = data.splitlines(keepends=True)
    for _ in range(min(len(lines), 3)):
        line = rng.randrange(len(lines))
        what = rng.choice(("lose", "double", "move"))
        kept = lines.pop(line)
        if what != "lose":
            lines.insert(line, kept)
            lines.insert(rng.randrange(len(lines)), kept)
        if what == "move":
            lines.pop(line)
        if not lines:
            break
    return b"".join(lines)


def _spliced(data: bytes, others: Sequence[bytes], rng: random.Random) -> bytes:
    other = rng.choice(others)
    return data[: _spot(data, rng)] + other[_spot(other, rng) :]


def _noise(data: bytes, _others: Sequence[bytes], rng: random.Random) -> bytes:
    spot = _spot(data, rng)
    return data[:spot] + rng.randbytes(rng.choice((1, 16, 1000))) + data[spot:]


def _saved_otherwise(data: bytes, _others: Sequence[bytes], rng: random.Random) -> bytes:
    """As another editor or system would have saved it."""
    text = data.decode("utf-8", errors="replace")
    ways: Sequence[Callable[[], bytes]] = (
        lambda: text.encode("utf-16"),
        lambda: text.encode("utf-32"),
        lambda: text.encode("latin-1", errors="replace"),
        lambda: b"\xef\xbb\xbf" + data,
        lambda: data.replace(b"\n", b"\r\n"),
        lambda: data.replace(b"\n", b"\r"),
        lambda: data.replace(b"\n", b"\n\n"),
        lambda: data.replace(b" ", b"\t"),
        lambda: data.replace(b".", b","),
        lambda: data.replace(b",", b";"),
        lambda: data.replace(b"\n", b" "),
        lambda: data + data,
        lambda: data.upper(),
    )
    return rng.choice(ways)()


CHANGES = (
    *(_bytes_flipped, _token_inserted, _token_inserted, _value_replaced, _value_replaced, _cut),
    *(_part_lost, _part_repeated, _lines_mixed, _spliced, _noise, _saved_otherwise),
)


def no_files() -> tuple[Oddity, ...]:
    """What is not an ordinary file, or is one of a size that no reader should begin to read."""
    return (
        Oddity("nothing", lambda _path: None),
        of_bytes("empty", b""),
        Oddity("a folder", lambda path: path.mkdir()),
        Oddity("a pipe that nobody writes", lambda path: os.mkfifo(path)),
        Oddity("a socket", _socket),
        Oddity("a link in a circle", lambda path: path.symlink_to(path.name)),
        Oddity("a link to nothing", lambda path: path.symlink_to("not-there")),
        Oddity("a link to /dev/zero", lambda path: path.symlink_to("/dev/zero")),
        Oddity("a link to /dev/null", lambda path: path.symlink_to("/dev/null")),
        Oddity("a link to /proc/self/mem", lambda path: path.symlink_to("/proc/self/mem")),
        Oddity("a link to its folder", lambda path: path.symlink_to(".")),
        Oddity("50 GiB of nothing", _sparse),
        made("30 MiB on one line", lambda: b"x" * (30 * MIB)),
        made("5 MB on one line", lambda: b"x" * 5_000_000),
        made("0.9 MB of blanks", lambda: b" " * 900_000),
        made("0.9 MB of lines", lambda: b"\n" * 900_000),
        made("19 MB of lines", lambda: b"\n" * 19_000_000),
        made("0.9 MB of NUL", lambda: b"\x00" * 900_000),
        of_bytes("UTF-16", "schema: x\n".encode("utf-16")),
    )


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(os.path.relpath(path))  # an absolute one may be too long


def _sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(SPARSE_BYTES)


def of_yaml(data: bytes) -> tuple[Oddity, ...]:
    """What a YAML file can be made of beside what it should hold, `data`."""
    head = data.split(b"\n", 1)[0] + b"\n"
    lol = b"a0: &a0 [x,x,x,x,x,x,x,x,x]\n" + b"".join(
        b"a%d: &a%d [%s]\n" % (level, level, b",".join([b"*a%d" % (level - 1)] * 9))
        for level in range(1, 10)
    )
    texts: Mapping[str, Callable[[], bytes]] = {
        "ten levels of aliases": lambda: head + lol,
        "a list within itself": lambda: head + b"a: &a [*a]\n",
        "a merge key": lambda: head + b"x: &x {a: 1}\n<<: *x\n",
        "an anchor": lambda: data.replace(b": ", b": &anchor ", 1),
        "nested 200 deep": lambda: head + b"a: " + b"[" * 200 + b"]" * 200,
        "nested 100000 deep": lambda: head + b"a: " + b"[" * 100_000,
        "nested 5000 blocks": lambda: head + b"\n".join(b" " * n + b"a:" for n in range(1000)),
        "100000 dashes": lambda: head + b"a: " + b"\n  " + b"- " * 100_000,
        "100000 keys": lambda: head + b"".join(b"k%d: 1\n" % n for n in range(70_000)),
        "a list of 300000": lambda: head + b"a: [" + b"1," * 300_000 + b"]\n",
        "a list of 200000 lines": lambda: head + b"a:\n" + b"- 1\n" * 200_000,
        "200000 comments": lambda: data + b"# x\n" * 200_000,
        "schema of 5000 digits": lambda: b"schema: " + b"9" * 5000 + b"\n",
        "schema with 5000 digits": lambda: b"schema: pkmcal/robot/" + b"9" * 5000 + b"\n",
        "schema a list": lambda: b"schema: [1, 2]\n",
        "schema a date": lambda: b"schema: 2026-01-01\n",
        "keys of every kind": lambda: (
            head + b"1: 1\n1.5: 1\ntrue: 1\nnull: 1\n2026-01-01: 1\n? [1]\n: 2\n"
        ),
        "a key of 0.9 MB": lambda: head + b"k" * 900_000 + b": 1\n",
        "a text of 0.9 MB": lambda: head + b"name: " + b"k" * 900_000 + b"\n",
        "a quoted text of 0.9 MB": lambda: head + b'name: "' + b"\\u202e" * 150_000 + b'"\n',
        "a number of 0.9 MB": lambda: head + b"name: " + b"9" * 900_000 + b"\n",
        "a decimal of 0.9 MB": lambda: head + b"name: 0." + b"9" * 900_000 + b"\n",
        "an exponent of 4000 digits": lambda: head + b"name: 1e" + b"9" * 4000 + b"\n",
        "a base-60 number": lambda: head + b"name: " + b"9:" * 3000 + b"59\n",
        "a binary": lambda: head + b"name: !!binary aGFsbG8=\n",
        "a tag of Python": lambda: head + b"name: !!python/object/apply:os.system ['true']\n",
        "a wrong timestamp": lambda: head + b"name: !!timestamp x\n",
        "an omap": lambda: head + b"name: !!omap [a: 1]\n",
        "a set": lambda: head + b"name: !!set {a, b}\n",
        "a directive twice": lambda: b"%YAML 1.2\n%YAML 1.2\n---\n" + data,
        "a directive of another version": lambda: b"%YAML 1.1\n---\n" + data,
        "a wrong version": lambda: b"%YAML 9999999999999999999999.1\n---\n" + data,
        "a tag directive": lambda: b"%TAG ! tag:x,2000:\n---\n" + data,
        "two documents": lambda: data + b"\n---\n" + data,
        "every key twice": lambda: data + b"\n" + data,
        "controls in a name": lambda: head + b'name: "\\e[2J\\u202E\\a\\0\\u2028\\x85"\n',
        "a surrogate": lambda: head + b'name: "\\ud800"\n',
        "all null": lambda: (
            head
            + b"".join(
                line.split(b":")[0] + b":\n" for line in data.splitlines()[1:] if b":" in line
            )
        ),
    }
    return tuple(map(made, texts, texts.values()))


def of_csv(data: bytes) -> tuple[Oddity, ...]:
    """What a CSV file can be made of beside what it should hold, `data`."""
    header, _, rest = data.partition(b"\n")
    row = rest.split(b"\n")[0]
    many = row + b"\n"
    columns = header.count(b",")
    texts: Mapping[str, Callable[[], bytes]] = {
        "a cell of 5 MB": lambda: header + b"\n" + b"x" * 5_000_000 + b"," * columns,
        "an open quote before 19 MB": lambda: header + b'\n"' + many * (19_000_000 // len(many)),
        "19 MB of one row": lambda: header + b"\n" + many * (19_000_000 // len(many)),
        "19 MB of empty rows": lambda: header + b"\n" + (b"," * columns + b"\n") * 1_000_000,
        "a million commas": lambda: header + b"\n" + b"," * 1_000_000,
        "a header of a million columns": lambda: b"x," * 1_000_000 + b"\n" + row,
        "5 MB without a separator": lambda: b"x" * 5_000_000 + b"\n" + row,
        "500000 short lines": lambda: header + b"\n" + b"1\n" * 500_000,
        "only a header": lambda: header + b"\n",
        "a header twice": lambda: header + b"\n" + data,
        "rows without a header": lambda: rest,
        "every column twice": lambda: header + b"," + header + b"\n" + row + b"," + row,
        "a NUL in a cell": lambda: header + b"\n" + row.replace(b",", b"\x00,", 1),
        "a formula": lambda: header + b"\n" + row.replace(b",", b",=cmd|' /C calc'!A0,", 1),
        "digits of another script": lambda: header + b"\n" + "١٢٣".encode() + row,
        "a number of 100000 digits": lambda: header + b"\n" + b"9" * 100_000 + row,
        "exponents": lambda: header + b"\n" + b",".join([b"1e400"] * (columns + 1)),
        "not numbers": lambda: header + b"\n" + b",".join([b"nan"] * (columns + 1)),
        "huge numbers": lambda: header + b"\n" + b",".join([b"1e300"] * (columns + 1)),
        "huge whole numbers": lambda: header + b"\n" + b",".join([b"9" * 17] * (columns + 1)),
        "zeros": lambda: header + b"\n" + b",".join([b"0"] * (columns + 1)),
        "controls": lambda: (
            header + b"\n" + b",".join(["\x1b[2J\u202e\x07".encode()] * (columns + 1))
        ),
    }
    return tuple(map(made, texts, texts.values()))


def of_json(data: bytes) -> tuple[Oddity, ...]:
    """What a JSON file can be made of beside what it should hold, `data`."""
    known = json.loads(data)
    texts = {
        "nested 100000 deep": b"[" * 100_000,
        "nested objects": b'{"a":' * 50_000,
        "a list": b"[]",
        "a number of 5000 digits": b'{"seed": ' + b"9" * 5000 + b"}",
        "NaN": b'{"seed": NaN, "worked_s": Infinity}',
        "a surrogate": b'{"scenario": "\\ud800\\u202e"}',
        "a list of 5 MB": b"[" + b"1," * 2_500_000 + b"1]",
    }
    for key in known:
        for word, value in (("null", None), ("a huge number", 1e300), ("a text", "\x1b" * 50)):
            texts[f"{key} is {word}"] = json.dumps({**known, key: value}).encode()
    return tuple(of_bytes(name, text) for name, text in texts.items())


def of_journal(data: bytes) -> tuple[Oddity, ...]:
    """What a SQLite file can be made of beside what it should hold, `data`."""
    page = 4096
    texts = {f"byte {at} of the heading": _with(data, at, b"\xff") for at in range(0, 100, 7)}
    for at in range(page, len(data) - page, max(page, len(data) // 12)):
        texts[f"page at {at} empty"] = _with(data, at, b"\x00" * page)
        texts[f"page at {at} noise"] = _with(data, at, b"\xa5" * page)
    texts["only its heading"] = data[:100]
    texts["its half"] = data[: len(data) // 2]
    return tuple(of_bytes(name, text) for name, text in texts.items())


def _with(data: bytes, at: int, other: bytes) -> bytes:
    return data[:at] + other + data[at + len(other) :]


ODD_NAMES: Sequence[str] = (
    *("", ".", "..", "/", "a\x00b", "\x00", "x" * 300, "x/" * 3000, "\udcff", "a\nb", "\x1b[2J"),
    *("\u202egpj", "/dev/null", "/dev/zero", "/dev/tty", "/proc/self/mem", "/dev/stdin", "-"),
    *("~", "$HOME", "*", "con", "http://127.0.0.1/x", "//", "/nowhere/at/all", "x" * 100_000),
    *(" ", "\t", "a\\b", "é", "e\u0301", "/root/.", "/etc/shadow", "/proc/1/root/x"),
)
"""Names of files and folders that no file of a campaign has."""
