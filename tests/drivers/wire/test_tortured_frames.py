"""Every wire parser under random, changed, cut and joined frames: it reads, or raises `WireError`.

20 000 frames; `--times 50` for a million. None may hoard, and ten times the bytes may take ten
times the time: a ratio of 1 is linear, 10 is quadratic.
"""

import time
import tracemalloc
from collections import Counter
from random import Random

import pytest
from wire_frames import WIRES, frame

from drivers.errors import WireError
from drivers.wire.framing import LARGEST_PACKET_BYTES

FRAMES = 20_000
FLOODS = ("examples", "byte by byte", "longest frames")
FLOOD_BYTES, FLOOD_MB = 20_000, 1.0
SHORT_BYTES, TIMES_LONGER, MOST_RATIO, REPEATS = 70_000, 10, 3.0, 3
PIECE_BYTES = 512

each_wire = pytest.mark.parametrize("wire", WIRES, ids=lambda wire: wire.name)
torture = pytest.mark.torture


def tortured(wire, frames, seed=1):
    """How so many frames ended, each given to a parser of its own: read, refused, or otherwise."""
    draw, ends = Random(f"{seed} {wire.name}"), Counter()
    for _ in range(frames):
        feed, parts = wire.fresh(), frame(wire, draw)
        try:
            for part in parts:
                feed(part)
        except WireError:
            ends["refused"] += 1
        except Exception as error:  # noqa: BLE001 - whatever it is, it is found
            ends[f"{type(error).__name__} by {b''.join(parts)[:120]!r}"] += 1
        else:
            ends["read"] += 1
    return ends


def flood(wire, kind, size):
    """So many bytes, in the pieces in which they come."""
    examples = b"".join(wire.examples)
    data = (examples * (size // len(examples) + 1))[:size]
    if kind == "byte by byte":
        return [data[at : at + 1] for at in range(size // 10)]
    if kind == "longest frames":
        longest = LARGEST_PACKET_BYTES.to_bytes(4, "little").ljust(LARGEST_PACKET_BYTES, b"\0")
        data = (longest * (size // len(longest) + 1))[:size]  # as a line: one without an end
    return [data[at : at + PIECE_BYTES] for at in range(0, size, PIECE_BYTES)]


def drowned(wire, parts):
    """Feed it all; after a refusal it goes on with a fresh parser, as after a reconnection."""
    feed = wire.fresh()
    for part in parts:
        try:
            feed(part)
        except WireError:
            feed = wire.fresh()


def peak_mb(wire):
    """Most memory at once, of all floods."""
    tracemalloc.start()
    try:
        for kind in FLOODS:
            drowned(wire, flood(wire, kind, FLOOD_BYTES))
        return tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()


def seconds(wire, parts):
    """Least processor time over some repeats."""
    costs_s = []
    for _ in range(REPEATS):
        began_s = time.process_time()
        drowned(wire, parts)
        costs_s.append(time.process_time() - began_s)
    return min(costs_s)


@torture
@each_wire
def test_nothing_but_a_wire_error_comes_of_any_frame(wire, times):
    frames = -(-FRAMES * times // len(WIRES))
    ends = tortured(wire, frames)
    assert set(ends) <= {"read", "refused"}
    assert ends["read"] > frames // 20, "what is behind the checksums is reached too"
    assert ends["refused"] > 0 or wire.name == "lines"


@each_wire
def test_flood_is_taken_without_being_kept(wire):
    assert peak_mb(wire) < FLOOD_MB


@torture
@pytest.mark.long
@each_wire
@pytest.mark.parametrize("kind", FLOODS)
def test_ten_times_the_bytes_take_ten_times_the_time(wire, kind):
    short_s = seconds(wire, flood(wire, kind, SHORT_BYTES))
    long_s = seconds(wire, flood(wire, kind, TIMES_LONGER * SHORT_BYTES))
    assert long_s / (TIMES_LONGER * short_s) < MOST_RATIO
