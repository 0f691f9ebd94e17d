"""Parsers of every wire under random, mutated, cut and joined frames: what they raise and need.

python -m benchmarks.torture.fuzz [--frames N] [--seed N] [--json]

Frames are shared out evenly among the parsers. Nothing but `WireError` may come of any of them, at
most 50 MB may be needed at once, and ten times as many bytes may take ten times as long: a ratio of
1 is linear, 10 is quadratic. Exit code 1 when a limit is missed.
"""

import sys
import time
import tracemalloc
from collections import Counter
from dataclasses import dataclass, field
from random import Random

from benchmarks.shared.yardstick import Figure, Report, Table, main
from benchmarks.torture.wire_frames import WIRES, Wire, frame
from drivers.errors import WireError
from drivers.wire.framing import LARGEST_PACKET_BYTES

FRAMES = 1_000_000
MOST_MB = 50.0
MOST_RATIO = 3.0
SHORT_BYTES = 70_000
TIMES_LONGER = 10
PIECE_BYTES = 512
REPEATS = 3
WATCHED_FRAMES = 2000
"""Of each parser under the eyes of the memory's counter, which makes everything slow."""


@dataclass
class Findings:
    """What came of one parser's frames."""

    frames: int = 0
    read: int = 0
    """Frames that were read to their end without an error."""
    refused: int = 0
    others: Counter[str] = field(default_factory=Counter)
    """Exceptions other than `WireError`, by name and example."""


def tortured(wire: Wire, frames: int, seed: int) -> Findings:
    """Feed so many frames, each to a parser of its own."""
    draw, found = Random(f"{seed} {wire.name}"), Findings()
    for _ in range(frames):
        feed, parts = wire.fresh(), frame(wire, draw)
        found.frames += 1
        try:
            for part in parts:
                feed(part)
        except WireError:
            found.refused += 1
        except Exception as error:  # noqa: BLE001 - whatever it is, it is a finding
            found.others[f"{type(error).__name__} by {b''.join(parts)[:120]!r}"] += 1
        else:
            found.read += 1
    return found


FLOODS = ("examples", "byte by byte", "longest frames")


def flood(wire: Wire, kind: str, size: int) -> list[bytes]:
    """So many bytes, in the pieces in which they come."""
    examples = b"".join(wire.examples)
    data = (examples * (size // len(examples) + 1))[:size]
    if kind == "byte by byte":
        return [data[at : at + 1] for at in range(size // 10)]
    if kind == "longest frames":
        longest = LARGEST_PACKET_BYTES.to_bytes(4, "little").ljust(LARGEST_PACKET_BYTES, b"\0")
        data = (longest * (size // len(longest) + 1))[:size]  # as a line: one without an end
    return [data[at : at + PIECE_BYTES] for at in range(0, size, PIECE_BYTES)]


def seconds(wire: Wire, parts: list[bytes]) -> float:
    """Least processor time over some repeats; one that refuses is followed by a fresh one."""
    least_s = float("inf")
    for _ in range(REPEATS):
        began_s = time.process_time()
        drowned(wire, parts)
        least_s = min(least_s, time.process_time() - began_s)
    return least_s


def drowned(wire: Wire, parts: list[bytes]) -> None:
    """Feed it all; after a refusal it goes on with a fresh parser, as after a reconnection."""
    feed = wire.fresh()
    for part in parts:
        try:
            feed(part)
        except WireError:
            feed = wire.fresh()


def worst_ratio(wire: Wire, short_bytes: int) -> float:
    """Time of ten times the bytes over ten times the time, for the worst of all floods."""
    ratios = []
    for kind in FLOODS:
        short_s = seconds(wire, flood(wire, kind, short_bytes))
        long_s = seconds(wire, flood(wire, kind, TIMES_LONGER * short_bytes))
        ratios.append(long_s / (TIMES_LONGER * short_s))
    return max(ratios)


def peak_mb(wire: Wire, frames: int, seed: int) -> float:
    """Most memory at once, of frames and floods."""
    tracemalloc.start()
    try:
        tortured(wire, frames, seed)
        for kind in FLOODS:
            drowned(wire, flood(wire, kind, TIMES_LONGER * SHORT_BYTES))
        return tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()


def measure(frames: int, seed: int) -> Report:
    each = -(-frames // len(WIRES))
    rows, others, most_mb, ratio = [], Counter[str](), 0.0, 0.0
    for wire in WIRES:
        found = tortured(wire, each, seed)
        wire_mb = peak_mb(wire, min(each, WATCHED_FRAMES), seed)
        wire_ratio = worst_ratio(wire, SHORT_BYTES)
        others.update(found.others)
        most_mb, ratio = max(most_mb, wire_mb), max(ratio, wire_ratio)
        unforeseen = found.others.total()
        rows.append(
            (wire.name, found.frames, found.read, found.refused, unforeseen, wire_mb, wire_ratio)
        )
    columns = ("parser", "frames", "read", "refused", "other exceptions", "peak MB", "time ratio")
    tables = [Table("Wire parsers", columns, rows)]
    if others:
        tables.append(Table("Other exceptions", ("which", "how often"), others.most_common(20)))
    figures = [
        Figure("frames", each * len(WIRES)),
        Figure("exceptions other than WireError", others.total(), highest=0),
        Figure("peak memory", most_mb, "MB", highest=MOST_MB),
        Figure("time of ten times the bytes over ten times the time", ratio, highest=MOST_RATIO),
    ]
    return Report(figures, tables)


if __name__ == "__main__":
    sys.exit(main(__doc__, measure, frames=FRAMES, seed=1))
