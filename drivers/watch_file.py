"""A tracker whose own software appends its points to a file (docs/how-to/by-hand.md).

Only a row that comes after a measurement was asked for is its point. Whether it came after is
decided by what the file holds, not by any clock: neither the clock of the tracker's computer nor
times in the rows have to agree with ours.

1. Read the file: its whole rows, and a last line without a line end, which may still be written.
2. Read it again every `LOOK_S`, until there is a row that was not there before (`rows_since`).
3. Take it if it is the only new one and differs from the row before; else it is no measurement.

Some software appends, some writes the whole file again, and some replaces it: the rows decide.
"""

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from typing_extensions import override

from drivers import bounded_files, values
from drivers.declaration import Surroundings
from drivers.errors import Cancelled, LinkDown, NotAMeasurement
from drivers.plausible import require_point
from drivers.ports import LaserTracker
from drivers.wire.typed_numbers import typed_numbers

LOOK_S = 0.1
"""Pause between two readings of the file, s."""
AS_IT_STOOD = " = "
"""Behind the point in a record: the row as it stood in the file."""
AGAIN = "measure the point again, one row for each question"


@dataclass(frozen=True, slots=True, kw_only=True)
class WatchSettings:
    """Facts about the file; its format is one that `pkmcal import` reads."""

    serial: str
    path: Path
    wait_s: float
    """Time in which a row must come, s."""
    encoding: bounded_files.Encoding | None
    """Encoding of a file without a byte-order mark; None: UTF-8."""
    rows_of: Callable[[str], Sequence[str]]
    """Rows of a text that hold points: no header, comments or empty lines."""
    point_of: Callable[[str, str], values.Vector3]
    """Point, mm, of a row, with the whole text that it is from."""


@dataclass(frozen=True, slots=True)
class _Contents:
    """Contents of the file at a moment: whole rows, and a last line that has no end yet."""

    text: str
    rows: tuple[str, ...]
    partial: str

    def rows_since(self, before: "_Contents") -> list[str]:
        """Return the new rows; of a file that was replaced, those that the old one did not have."""
        # 1. Rows were appended: those behind the old ones are new. Was the first of them half
        #    written when the file was read before, then it was begun before the question, and is
        #    not taken.
        # 2. One row differs in its place: it was written again, say with more digits.
        # 3. The file was replaced: rows are new that the old one did not have, each as often.
        count = len(before.rows)
        if self.rows[:count] == before.rows:
            rows = [*self.rows[count:]]
            had_begun = rows and before.partial and rows[0].startswith(before.partial)
            return rows[1:] if had_begun else rows
        changed = sum(old != new for old, new in zip(before.rows, self.rows, strict=False))
        if changed == 1 and len(self.rows) == count > 1:
            return []
        old_rows = [*before.rows, before.partial]
        return [*(Counter(self.rows) - Counter(old_rows)).elements()]


class WatchedTracker(LaserTracker):
    """A tracker whose points are the rows that its software writes into a file."""

    def __init__(self, surroundings: Surroundings) -> None:
        self._settings = surroundings.settings_as(WatchSettings)
        self._clock = surroundings.clock
        self._cancelled = surroundings.cancelled
        self._announce = surroundings.announce
        self._name = f"file {self._settings.path.name}"
        # The row taken or refused last: the same row again is no measurement.
        self._last = ""

    def connect(self) -> None:
        """Raise `LinkDown` where there is no such folder; the file may come later."""
        if not self._settings.path.parent.is_dir():
            raise LinkDown(
                f"{self._name}: there is no folder {self._settings.path.parent}",
                remedy="correct tracker.url in campaign.yaml, or make the folder",
            )

    reconnect = connect

    @override
    def identity(self) -> values.Identity:
        return values.Identity("operator", "tracker", self._settings.serial, "-", "watched file")

    def prepare(self, reflector: str, measuring_time_s: float) -> None:  # noqa: ARG002
        """Read what the file holds; raises `LinkDown` where it cannot be read."""
        self._read_contents()
        if not self._settings.path.exists():
            self._announce(f"there is no file {self._settings.path} yet; it may come later")

    def measure(self) -> values.Measurement:
        """Wait for a new row; raises `NotAMeasurement` for none in time, for two, for the last one.

        `LinkDown` when the file cannot be read, `Cancelled` at the wish to stop.
        """
        before = now = self._read_contents()
        if before.rows:
            self._last = before.rows[-1]
        give_up_s = self._clock.now_s() + self._settings.wait_s
        minutes = self._settings.wait_s / 60.0
        self._announce(f"measure now: waiting for a row in {self._settings.path} ({minutes:g} min)")
        while True:
            if self._cancelled():
                problem = f"{self._name}: the wait for a row was abandoned"
                raise Cancelled(problem, remedy="start again when ready")
            now = self._read_contents(otherwise=now)
            if rows := now.rows_since(before):
                return self._measurement_of(rows, now.text)
            if self._clock.now_s() >= give_up_s:
                half = "; its last line has no line end" if now.partial else ""
                raise NotAMeasurement(
                    f"{self._name}: no new row for {self._settings.wait_s:g} s{half}",
                    remedy="measure when pkmcal says 'measure now'; see that the tracker's "
                    "software writes each row to this file at once, with its line end",
                )
            self._clock.sleep_s(LOOK_S)

    def _measurement_of(self, rows: Sequence[str], text: str) -> values.Measurement:
        if len(rows) > 1:
            raise NotAMeasurement(
                f"{self._name}: {len(rows)} new rows at once, which of them is it?", remedy=AGAIN
            )
        (row,) = rows
        before, self._last = self._last, row
        if row == before:
            raise NotAMeasurement(f"{self._name}: the row is that before: {row}", remedy=AGAIN)
        point_mm = self._settings.point_of(row, text)
        require_point(self._name, point_mm)
        raw = " ".join(map(repr, point_mm)) + AS_IT_STOOD + row
        return values.Measurement(point_mm, None, None, raw)

    def _read_contents(self, otherwise: _Contents | None = None) -> _Contents:
        """Read the file; returns `otherwise` while a writer keeps others from reading."""
        path = self._settings.path
        try:
            data = bounded_files.read_bounded(path, bounded_files.CSV_BYTES)
        except bounded_files.FileMissing:
            data = b""  # not there yet, or being replaced
        except bounded_files.FileRefused as error:
            if otherwise is not None:
                return otherwise
            raise LinkDown(error.problem, remedy=error.remedy) from error
        # A byte that cannot be read may be half of a sign that is still being written.
        codec = bounded_files.codec_of(data, self._settings.encoding)
        text = data.decode(codec, errors="replace").replace("\r\n", "\n").replace("\r", "\n")
        whole, _, partial = text.rpartition("\n")
        last = self._settings.rows_of(partial)
        return _Contents(text, tuple(self._settings.rows_of(whole)), last[-1] if last else "")


def recorded_measurement(raw: str) -> tuple[values.Vector3, None]:
    """Read a point, mm, from a record; raises `DriverError`."""
    point_mm = values.vector(typed_numbers(raw.partition(AS_IT_STOOD)[0], 3))
    require_point("the record of a row", point_mm)
    return point_mm, None
