"""The engine of every study: truth × perturbation × method → rows, and the tables they are kept in.

Rows are appended as they come and sorted at the end; what a table holds is not computed again.
No table is held in memory.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from itertools import chain, islice, zip_longest
from operator import attrgetter
from pathlib import Path
from typing import Any, BinaryIO, Generic, TypeVar

from pydantic import TypeAdapter
from pydantic_core import from_json

from campaigns.errors import OutputExists, WriteFailed
from campaigns.estimation.residual_stacks import closure_kernel
from campaigns.files.text_file import replace_text
from campaigns.journal.records import adapter_of
from campaigns.studies.estimates import estimated
from campaigns.studies.study import CampaignRow, StudyTask
from campaigns.studies.verdicts import judged
from drivers.bounded_files import MEGABYTE, FileRefused, is_there, open_file

MOST_LINE_BYTES = MEGABYTE
"""Of a table's line, some hundred times what a campaign needs; a table is as long as its study."""
LINE_END = b"\n"
key_of = attrgetter("key")
ANOTHER = "name another folder with --to, or move this file away"


def run_task(task: StudyTask) -> tuple[CampaignRow, ...]:
    """Rows of simulated campaigns; one that cannot be identified has a row too."""
    if task.setup.perturbation:
        return judged(task)
    return estimated(task, closure_kernel(task.setup.nominal) if task.setup.is_long else None)


Row = TypeVar("Row")
"""Row of a table, a dataclass or model with a `key`: its order, different for each row."""


@dataclass(frozen=True, slots=True, eq=False)
class ResultTable(Generic[Row]):
    """File of rows, a line of JSON each; in memory is only where each row lies in it.

    Its first line is `head`, if there is one: `study` in it tells one study from others.
    """

    path: Path
    kind: type[Row]
    """Class of the rows."""
    command: str
    head: Mapping[str, Any] | None = None
    places: dict[Any, int] = field(default_factory=dict)
    """By key: the byte at which its row begins, of those that were read or added."""

    def read(self) -> Mapping[Any, int]:
        """Take up what is there already, the last row of each key, but for one that was cut off.

        Raises `OutputExists` for a file that holds anything else.
        """
        if not is_there(self.path):
            return self.places
        lines = self._read_lines()
        if self.head is not None:
            self._check_head(next(lines, (0, b""))[1])
        for number, (place, line) in enumerate(lines, start=1 if self.head is None else 2):
            if not line.endswith(LINE_END):
                break
            try:
                row = self._adapter.validate_json(line)
            except ValueError as error:
                raise OutputExists(
                    f"{self.path}:{number}: is no result of `{self.command}`",
                    remedy="delete the line, or name another folder with --to",
                ) from error
            self.places[key_of(row)] = place
        return self.places

    def rows(self, keys: Iterable[Any]) -> Iterator[Row]:
        """Rows of these keys, each read when it is asked for; raises `OutputExists`."""
        for line in self._lines_of(keys):
            yield self._adapter.validate_json(line)

    def add(self, rows: Iterable[Row]) -> None:
        """Append rows to what was written; raises `WriteFailed`."""
        try:
            with self.path.open("ab") as file:
                for row in rows:
                    self.places[key_of(row)] = file.tell()
                    file.write(self._adapter.dump_json(row, exclude_none=True) + LINE_END)
        except OSError as error:
            raise WriteFailed(
                f"{self.path}: cannot be written ({error.strerror})",
                remedy="free space on the disk, then give the same command again: it goes on",
            ) from error

    def write(self) -> None:
        """Write all rows anew, by key, unless they lie so; raises `OutputExists`, `WriteFailed`."""
        head = "" if self.head is None else json.dumps(self.head, ensure_ascii=False) + "\n"
        keys = sorted(self.places)
        if is_there(self.path):
            found = (place for place, _ in islice(self._read_lines(), bool(head), None))
            if all(a == b for a, b in zip_longest((self.places[key] for key in keys), found)):
                return
        begins = [len(head.encode())]

        def lines() -> Iterator[str]:
            for line in self._lines_of(keys):
                begins.append(begins[-1] + len(line))
                yield line.decode()

        replace_text(self.path, chain([head], lines() if keys else ()))
        self.places.update(zip(keys, begins, strict=False))  # the last one is the end

    @property
    def _adapter(self) -> TypeAdapter[Row]:
        """What reads and writes rows."""
        return adapter_of(self.kind)

    def _lines_of(self, keys: Iterable[Any]) -> Iterator[bytes]:
        """Lines of these rows with their ends."""
        with self._opened() as file:
            for key in keys:
                file.seek(self.places[key])
                yield file.readline()

    def _read_lines(self) -> Iterator[tuple[int, bytes]]:
        """Every line with its end, and at which byte it begins; the last one may be cut off."""
        place = 0
        with self._opened() as file:
            while line := file.readline(MOST_LINE_BYTES):
                if len(line) == MOST_LINE_BYTES and not line.endswith(LINE_END):
                    raise OutputExists(
                        f"{self.path}: a line has more than {MOST_LINE_BYTES / MEGABYTE:g} MB, the "
                        "most that is read of one",
                        remedy=ANOTHER,
                    )
                yield place, line
                place += len(line)

    @contextmanager
    def _opened(self) -> Iterator[BinaryIO]:
        try:
            with open_file(self.path) as file:
                yield file
        except FileRefused as error:
            raise OutputExists(error.problem, remedy=error.remedy) from error

    def _check_head(self, line: bytes) -> None:
        """Raise `OutputExists` before any row is looked at."""
        head = self.head or {}
        try:
            there = from_json(line)
        except ValueError:
            there = None
        if there == json.loads(json.dumps(head)):
            return
        if not isinstance(there, dict) or there.get("schema") != head["schema"]:
            problem = f"is no table of `{self.command}` by this version"
        elif there.get("parameters") != list(head["parameters"]):
            problem = "belongs to a study of other parameters"
        else:
            problem = (
                "belongs to another study: other plan, robots, noise, effect, estimator, model or "
                "seed"
            )
        raise OutputExists(f"{self.path}: {problem}", remedy=ANOTHER)
