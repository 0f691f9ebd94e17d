"""Every wire parser under 20 000 tortured frames: it reads, or raises the one documented error."""

import tracemalloc

import pytest

from benchmarks.torture import fuzz
from benchmarks.torture.fuzz import FLOODS, MOST_MB, drowned, flood, tortured
from benchmarks.torture.wire_frames import WIRES, Wire
from drivers.errors import WireError
from drivers.wire.linuxcncrsh import read_message

FRAMES = 20_000
FLOOD_BYTES = 20_000

each_wire = pytest.mark.parametrize("wire", WIRES, ids=lambda wire: wire.name)


@each_wire
def test_example_is_read_whole(wire):
    for example in wire.examples:
        assert wire.resealed(example) == example
        wire.fresh()(example)


@each_wire
def test_nothing_but_a_wire_error_comes_of_any_frame(wire):
    found = tortured(wire, -(-FRAMES // len(WIRES)), seed=1)
    assert found.others == {}
    assert found.read > found.frames // 20, "what is behind the checksums is reached too"
    assert found.refused > 0 or wire.name == "lines"


@each_wire
def test_flood_is_taken_without_being_kept(wire):
    tracemalloc.start()
    try:
        for kind in FLOODS:
            drowned(wire, flood(wire, kind, FLOOD_BYTES))
        assert tracemalloc.get_traced_memory()[1] < 1e6 * MOST_MB / 50.0
    finally:
        tracemalloc.stop()


def test_exception_that_is_none_of_ours_is_found():
    def fresh():
        def feed(data):
            for line in data.replace(b"\r", b"\n").split(b"\n"):
                if line.strip():  # as it was: white space of Unicode's is not stripped
                    assert read_message(line) is not None

        return feed

    once = Wire("as it was", fresh, WIRES[-1].examples)
    found = tortured(once, 2000, seed=1)
    assert any(each.startswith("AssertionError") for each in found.others)


def test_parser_that_hoards_misses_its_limit(monkeypatch):
    def fresh():
        kept = b""

        def feed(data):
            nonlocal kept
            kept += data
            if b"\xfe" in kept:
                raise WireError("-")

        return feed

    monkeypatch.setattr(fuzz, "WIRES", (Wire("hoarder", fresh, (b"x" * 99,)),))
    monkeypatch.setattr(fuzz, "SHORT_BYTES", 15_000)
    monkeypatch.setattr(fuzz, "MOST_MB", 0.1)
    report = fuzz.measure(frames=20, seed=1)
    assert "peak memory" in report.missed
