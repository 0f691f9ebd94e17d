"""Tables of results that are kept while they come: a line of JSON each.

Rows are appended as they come and sorted at the end; what a table holds is not computed again.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import Any, Generic, TypeVar

from pydantic import TypeAdapter
from pydantic_core import from_json

from campaigns.errors import OutputExists, WriteFailed
from campaigns.files.text_file import replace_text
from campaigns.journal.records import adapter_of
from drivers.bounded_files import MEGABYTE, FileRefused, is_there, open_file

MOST_LINE_BYTES = MEGABYTE
"""Of a table's line, some hundred times what a campaign needs; a table is as long as its study."""
LINE_END = b"\n"
key_of = attrgetter("key")
ANOTHER = "name another folder with --to, or move this file away"

Row = TypeVar("Row")
"""Row of a table, a dataclass or model with a `key`: its order, different for each row."""


@dataclass(frozen=True, slots=True, eq=False)
class ResultTable(Generic[Row]):
    """File of rows, a line of JSON each.

    Its first line is `head`, if there is one: `study` in it tells one study from others.
    """

    path: Path
    kind: type[Row]
    """Class of the rows."""
    command: str
    head: Mapping[str, Any] | None = None
    by_key: dict[Any, Row] = field(default_factory=dict)
    """Rows that were read or added."""

    def read(self) -> Mapping[Any, Row]:
        """Take up what is there already, the last row of each key, but for one that was cut off.

        Raises `OutputExists` for a file that holds anything else.
        """
        if not is_there(self.path):
            return self.by_key
        lines = self._read_lines()
        if self.head is not None:
            self._check_head(next(lines, b""))
        for number, line in enumerate(lines, start=1 if self.head is None else 2):
            if not line.endswith(LINE_END):
                break
            try:
                row = self._adapter.validate_json(line)
            except ValueError as error:
                raise OutputExists(
                    f"{self.path}:{number}: is no result of `{self.command}`",
                    remedy="delete the line, or name another folder with --to",
                ) from error
            self.by_key[key_of(row)] = row
        return self.by_key

    def rows(self, keys: Iterable[Any]) -> Iterator[Row]:
        """Rows of these keys."""
        return (self.by_key[key] for key in keys)

    def add(self, rows: Iterable[Row]) -> None:
        """Append rows to what was written; raises `WriteFailed`."""
        try:
            with self.path.open("ab") as file:
                for row in rows:
                    file.write(self._line_of(row))
                    self.by_key[key_of(row)] = row
        except OSError as error:
            raise WriteFailed(
                f"{self.path}: cannot be written ({error.strerror})",
                remedy="free space on the disk, then give the same command again: it goes on",
            ) from error

    def write(self) -> None:
        """Write all rows anew, by key; raises `WriteFailed`."""
        head = "" if self.head is None else json.dumps(self.head, ensure_ascii=False) + "\n"
        lines = (self._line_of(self.by_key[key]).decode() for key in sorted(self.by_key))
        replace_text(self.path, "".join([head, *lines]))

    @property
    def _adapter(self) -> TypeAdapter[Row]:
        """What reads and writes rows."""
        return adapter_of(self.kind)

    def _line_of(self, row: Row) -> bytes:
        return self._adapter.dump_json(row, exclude_none=True) + LINE_END

    def _read_lines(self) -> Iterator[bytes]:
        """Every line with its end; the last one may be cut off."""
        try:
            with open_file(self.path) as file:
                while line := file.readline(MOST_LINE_BYTES):
                    if len(line) == MOST_LINE_BYTES and not line.endswith(LINE_END):
                        raise OutputExists(
                            f"{self.path}: a line has more than {MOST_LINE_BYTES / MEGABYTE:g} MB, "
                            "the most that is read of one",
                            remedy=ANOTHER,
                        )
                    yield line
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
            problem = "belongs to another study: other plan, robots, noise, model or seed"
        raise OutputExists(f"{self.path}: {problem}", remedy=ANOTHER)
