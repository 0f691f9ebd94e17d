"""The engine of every study: truth × perturbation × method → rows, and the tables they are kept in.

Rows are appended as they come and sorted at the end; what a table holds is not computed again.
"""

import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import Any, Generic, TypeVar

from pydantic import TypeAdapter
from pydantic_core import from_json

from campaigns.errors import OutputExists, WriteFailed
from campaigns.files.text_file import read_text, replace_text
from campaigns.studies.estimates import estimated
from campaigns.studies.study import CampaignRow, StudyTask
from campaigns.studies.verdicts import judged
from drivers.bounded_files import MEGABYTE, is_there

MOST_BYTES = 50 * MEGABYTE
"""Of a table: some 30 000 campaigns with two dozen parameters each."""
key_of = attrgetter("key")
ANOTHER = "name another folder with --to, or move this file away"


def run_task(task: StudyTask) -> tuple[CampaignRow, ...]:
    """Rows of simulated campaigns; one that cannot be identified has a row too."""
    return judged(task) if task.setup.perturbation else estimated(task)


Row = TypeVar("Row")
"""Row of a table, a dataclass or model with a `key`: its order, different for each row."""


@dataclass(frozen=True, slots=True, eq=False)
class ResultTable(Generic[Row]):
    """File of rows, a line of JSON each, and those of its rows that were read or added.

    Its first line is `head`, if there is one: `study` in it tells one study from others.
    """

    path: Path
    kind: type[Row]
    """Class of the rows."""
    command: str
    head: Mapping[str, Any] | None = None
    rows: dict[Any, Row] = field(default_factory=dict)
    """By key."""

    def read(self) -> Mapping[Any, Row]:
        """Take up what is there already, the last row of each key, but for one that was cut off.

        Raises `OutputExists` for a file that holds anything else.
        """
        if not is_there(self.path):
            return self.rows
        text = read_text(self.path, OutputExists, if_missing="name another", most_bytes=MOST_BYTES)
        lines = enumerate(text.split("\n")[:-1], start=1)
        if self.head is not None:
            self._check_head(next(lines, (1, ""))[1])
        adapter = TypeAdapter(self.kind)
        for number, line in lines:
            try:
                self._take([adapter.validate_json(line)])
            except ValueError as error:
                raise OutputExists(
                    f"{self.path}:{number}: is no result of `{self.command}`",
                    remedy="delete the line, or name another folder with --to",
                ) from error
        return self.rows

    def add(self, rows: Iterable[Row]) -> None:
        """Append rows to what was written; raises `WriteFailed`."""
        taken = self._take(rows)
        try:
            with self.path.open("a", encoding="utf-8", newline="") as file:
                file.write(self._lines(taken))
        except OSError as error:
            raise WriteFailed(
                f"{self.path}: cannot be written ({error.strerror})",
                remedy="free space on the disk, then give the same command again: it goes on",
            ) from error

    def write(self) -> None:
        """Write all rows anew, by key; raises `WriteFailed`."""
        head = "" if self.head is None else json.dumps(self.head, ensure_ascii=False) + "\n"
        replace_text(self.path, head + self._lines(self.rows[key] for key in sorted(self.rows)))

    def _take(self, rows: Iterable[Row]) -> list[Row]:
        taken = list(rows)
        self.rows.update((key_of(row), row) for row in taken)
        return taken

    def _lines(self, rows: Iterable[Row]) -> str:
        adapter = TypeAdapter(self.kind)
        return "".join(adapter.dump_json(row, exclude_none=True).decode() + "\n" for row in rows)

    def _check_head(self, line: str) -> None:
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
