"""Odd files: what a disk, an editor or a stranger can make of a file, and things that are no files.

An `Oddity` puts something in a file's place. Those that are drawn change the file's bytes, the
others are the same for every file of a kind.
"""

import os
import random
import socket
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

KIB, MIB = 1024, 1024**2


class Oddity(NamedTuple):
    """Something odd with its name: `put` makes it stand in a file's place."""

    name: str
    put: Callable[[Path], object]


TOKENS: Sequence[bytes] = (
    *(b"\x00", b"\xff", b"\xef\xbb\xbf", b"\xed\xa0\x80", b"\x1b[2J\x1b[31m", b"\x07"),
    *("\u202e\u2066".encode(), "\u2028".encode(), "\x85".encode(), "٣".encode(), "−1".encode()),
    *(b"*a", b"<<: *a", b"!!python/object:os.system ", b"? ", b"- ", b"[", b"}", b"|", b"---"),
    *(b"#", b"\t", b"'", b'"', b"\\", b": ", b",", b";", b"\n", b"\r", b"=1+1", b"null", b"yes"),
    *(b".nan", b"-.inf", b"1e400", b"1e-400", b"1_000", b"0x1", b"010", b"1:30", b"2026-01-01"),
    *(b"9" * 5000, b"-" + b"9" * 400, b"1,5", b"+-1", b"0", b"-0.0", b"5e-324", b"1e308"),
    *(b"sim://" + b"x" * 3000, b"sim://../../etc", b"serial:///dev/null?baud=x"),
    *(b" " * 2000, b"A" * (64 * KIB)),
)
EDITORS: Sequence[Callable[[bytes], bytes]] = (
    lambda data: data.decode(errors="replace").encode("utf-16"),
    lambda data: data.decode(errors="replace").encode("latin-1", errors="replace"),
    lambda data: data.replace(b"\n", b"\r"),
    lambda data: data.replace(b" ", b"\t"),
    lambda data: data.replace(b".", b","),
    lambda data: data.replace(b",", b";"),
    lambda data: data + data,
    lambda data: data.upper(),
)
"""As another editor or system would have saved a file."""


def drawn(data: bytes, others: Sequence[bytes], rng: random.Random) -> Oddity:
    """Draw one to three changes of a file's bytes, made one after the other."""
    names = rng.choices(CHANGES, k=rng.choice((1, 1, 1, 2, 3)))
    for name in names:
        data = _changed(name, data, others, rng)
    return _of_bytes("+".join(names), data)


CHANGES = ("insert", "insert", "replace", "replace", "cut", "repeat", "lines", "splice", "noise")
CHANGES += ("save",)


def _changed(name: str, data: bytes, others: Sequence[bytes], rng: random.Random) -> bytes:
    first = rng.randrange(len(data) + 1)
    last = min(len(data), first + rng.choice((1, 2, 5, 20, 200)))
    match name:
        case "insert":
            return data[:first] + rng.choice(TOKENS) + data[first:]
        case "replace":  # what stands after a colon or comma
            marks = [at + 1 for at, sign in enumerate(data) if sign in b":,"]
            start = rng.choice(marks or [0])
            end = next((at for at in range(start, len(data)) if data[at] in b",\n]}"), len(data))
            return data[:start] + b" " + rng.choice(TOKENS) + data[end:]
        case "cut":
            return data[:first]
        case "repeat":
            return data[:last] + data[first:last] * rng.choice((1, 3, 50)) + data[last:]
        case "lines":  # some lost, some doubled, all in another order
            lines = data.splitlines(keepends=True)
            return b"".join(rng.choices(lines, k=len(lines))) if lines else data
        case "splice":
            other = rng.choice(others)
            return data[:first] + other[rng.randrange(len(other) + 1) :]
        case "noise":  # instead of some bytes
            return data[:first] + rng.randbytes(rng.choice((1, 16, 1000))) + data[last:]
        case _:
            return rng.choice(EDITORS)(data)


def _of_bytes(name: str, data: bytes) -> Oddity:
    return Oddity(name, lambda path: path.write_bytes(data))


def _of_texts(texts: Mapping[str, Callable[[], bytes]]) -> tuple[Oddity, ...]:
    """Files of bytes that are made only when they are put there, for they may be many."""
    return tuple(
        Oddity(name, lambda path, make=make: path.write_bytes(make()))
        for name, make in texts.items()
    )


def no_files() -> tuple[Oddity, ...]:
    """Things that are no ordinary files, or of a size that no reader should begin to read."""
    links = (".", "not-there", "/dev/zero", "/dev/null", "/proc/self/mem")
    return (
        Oddity("nothing", lambda _path: None),
        Oddity("a folder", lambda path: path.mkdir()),
        Oddity("a pipe that nobody writes", os.mkfifo),
        Oddity("a socket", _socket),
        Oddity("a link in a circle", lambda path: path.symlink_to(path.name)),
        *(Oddity(f"a link to {to}", lambda path, to=to: path.symlink_to(to)) for to in links),
        Oddity("50 GiB of nothing", _sparse),
        *_of_texts(
            {
                "empty": lambda: b"",
                "30 MiB on one line": lambda: b"x" * (30 * MIB),
                "0.9 MB of blanks": lambda: b" " * 900_000,
                "19 MB of lines": lambda: b"\n" * 19_000_000,
                "0.9 MB of NUL": lambda: b"\x00" * 900_000,
            }
        ),
    )


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(os.path.relpath(path))  # an absolute one may be too long


def _sparse(path: Path) -> None:
    with path.open("wb") as file:
        file.truncate(50 * 1024 * MIB)


def of_yaml(data: bytes) -> tuple[Oddity, ...]:
    """What a YAML file can be made of beside what it should hold, `data`."""
    head = data.split(b"\n", 1)[0] + b"\n"
    lol = b"a0: &a0 [x,x,x,x,x,x,x,x,x]\n" + b"".join(
        b"a%d: &a%d [%s]\n" % (level, level, b",".join([b"*a%d" % (level - 1)] * 9))
        for level in range(1, 10)
    )
    keys = [line.split(b":")[0] for line in data.splitlines()[1:] if b":" in line]
    values = {
        "a quoted text of 0.9 MB": b'"' + b"\\u202e" * 150_000 + b'"',
        "a number of 0.9 MB": b"9" * 900_000,
        "an exponent of 4000 digits": b"1e" + b"9" * 4000,
        "a base-60 number": b"9:" * 3000 + b"59",
        "a tag of Python": b"!!python/object/apply:os.system ['true']",
        "a wrong timestamp": b"!!timestamp x",
        "controls in a name": b'"\\e[2J\\u202E\\a\\0\\u2028\\x85"',
        "a surrogate": b'"\\ud800"',
    }
    return _of_texts(
        {
            name: lambda value=value: head + b"name: " + value + b"\n"
            for name, value in values.items()
        }
        | {
            "ten levels of aliases": lambda: head + lol,
            "a list within itself": lambda: head + b"a: &a [*a]\n",
            "a merge key": lambda: head + b"x: &x {a: 1}\n<<: *x\n",
            "nested 100000 deep": lambda: head + b"a: " + b"[" * 100_000,
            "100000 dashes": lambda: head + b"a: " + b"\n  " + b"- " * 100_000,
            "70000 keys": lambda: head + b"".join(b"k%d: 1\n" % n for n in range(70_000)),
            "a list of 200000 lines": lambda: head + b"a:\n" + b"- 1\n" * 200_000,
            "200000 comments": lambda: data + b"# x\n" * 200_000,
            "schema with 5000 digits": lambda: b"schema: pkmcal/robot/" + b"9" * 5000 + b"\n",
            "schema a list": lambda: b"schema: [1, 2]\n",
            "keys of every kind": lambda: head + b"1: 1\n1.5: 1\ntrue: 1\nnull: 1\n? [1]\n: 2\n",
            "a key of 0.9 MB": lambda: head + b"k" * 900_000 + b": 1\n",
            "a wrong version": lambda: b"%YAML 9999999999999999999999.1\n---\n" + data,
            "two documents": lambda: data + b"\n---\n" + data,
            "every key twice": lambda: data + b"\n" + data,
            "all null": lambda: head + b"".join(key + b":\n" for key in keys),
        }
    )


def of_csv(data: bytes) -> tuple[Oddity, ...]:
    """What a CSV file can be made of beside what it should hold, `data`."""
    header, _, rest = data.partition(b"\n")
    row = rest.split(b"\n")[0]
    many, columns = row + b"\n", header.count(b",") + 1
    cells = {
        "not numbers": b"nan",
        "huge numbers": b"1e300",
        "huge whole numbers": b"9" * 17,
        "controls": "\x1b[2J\u202e\x07".encode(),
        "nothing": b"",
    }
    rows = {
        "a NUL in a cell": row.replace(b",", b"\x00,", 1),
        "a formula": row.replace(b",", b",=cmd|' /C calc'!A0,", 1),
        "digits of another script": "١٢٣".encode() + row,
        "a number of 100000 digits": b"9" * 100_000 + row,
        "a header twice": data,
        **{name: b",".join([cell] * columns) for name, cell in cells.items()},
    }
    return _of_texts(
        {name: lambda text=text: header + b"\n" + text for name, text in rows.items()}
        | {
            "a cell of 5 MB": lambda: header + b"\n" + b"x" * 5_000_000 + b"," * (columns - 1),
            "an open quote before 19 MB": lambda: (
                header + b'\n"' + many * (19_000_000 // len(many))
            ),
            "19 MB of one row": lambda: header + b"\n" + many * (19_000_000 // len(many)),
            "a million commas": lambda: header + b"\n" + b"," * 1_000_000,
            "a header of a million columns": lambda: b"x," * 1_000_000 + b"\n" + row,
            "500000 short lines": lambda: header + b"\n" + b"1\n" * 500_000,
            "every column twice": lambda: header + b"," + header + b"\n" + row + b"," + row,
        }
    )


def of_journal(data: bytes) -> tuple[Oddity, ...]:
    """What a SQLite file can be made of beside what it should hold, `data`."""
    page = 4096

    def with_bytes(at: int, other: bytes) -> bytes:
        return data[:at] + other + data[at + len(other) :]

    texts = {f"byte {at} of the heading": with_bytes(at, b"\xff") for at in range(0, 100, 7)}
    for at in range(page, len(data) - page, max(page, len(data) // 12)):
        texts[f"page at {at} empty"] = with_bytes(at, b"\x00" * page)
        texts[f"page at {at} noise"] = with_bytes(at, b"\xa5" * page)
    texts["only its heading"] = data[:100]
    texts["its half"] = data[: len(data) // 2]
    return tuple(_of_bytes(name, text) for name, text in texts.items())


ODD_NAMES: Sequence[str] = (
    *("", ".", "..", "/", "a\x00b", "\x00", "x" * 300, "x/" * 3000, "\udcff", "a\nb", "\x1b[2J"),
    *("\u202egpj", "/dev/null", "/dev/zero", "/dev/tty", "/proc/self/mem", "/dev/stdin", "-"),
    *("~", "$HOME", "*", "con", "http://127.0.0.1/x", "//", "/nowhere/at/all", "x" * 100_000),
    *(" ", "\t", "a\\b", "é", "e\u0301", "/root/.", "/etc/shadow", "/proc/1/root/x"),
)
"""Names of files and folders that no file of a campaign has."""
