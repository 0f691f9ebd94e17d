"""Table of a study: its campaigns, a line of JSON each, kept as they are simulated.

Rows are appended as they come, so a study that is stopped or killed loses at most the line it was
writing; the same command goes on with the campaigns that the table lacks. At the end the table is
written again in the order of numbers, so it does not depend on who computed what first. The first
line names the study: rows of another plan, robot, noise or seed are never mixed with it.
"""

import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter
from pydantic_core import from_json

from campaigns.errors import OutputExists, WriteFailed
from campaigns.files.text_file import replace_text
from campaigns.studies.study import CampaignRow
from drivers.bounded_files import MEGABYTE, FileRefused, is_there, open_file

MOST_LINE_BYTES = MEGABYTE
"""Longest line that is read, some hundred times what a campaign needs."""
LINE_END = b"\n"
OTHER_FOLDER = "name another folder with --to, or move this file away"
_ROWS = TypeAdapter(CampaignRow)


@dataclass(frozen=True, slots=True, eq=False)
class StudyTable:
    """File of campaigns; its first line is `head`, whose `study` distinguishes studies."""

    path: Path
    head: Mapping[str, Any]
    by_number: dict[int, CampaignRow] = field(default_factory=dict)
    """Rows that were read or added."""

    def read(self) -> None:
        """Read the rows that the file holds, except one that was cut off.

        Raise `OutputExists` for a file that holds anything else.
        """
        if not is_there(self.path):
            return
        lines = self._read_lines()
        self._check_head(next(lines, b""))
        for number, line in enumerate(lines, start=2):
            if not line.endswith(LINE_END):  # cut off by the end of a process: simulate it again
                break
            try:
                row = _ROWS.validate_json(line)
            except ValueError as error:
                raise OutputExists(
                    f"{self.path}:{number}: is no result of `pkmcal study`",
                    remedy="delete the line, or name another folder with --to",
                ) from error
            self.by_number[row.campaign] = row

    def add(self, rows: Iterable[CampaignRow]) -> None:
        """Append rows to what was written; raise `WriteFailed`."""
        try:
            with self.path.open("ab") as file:  # bytes: no system's line ends
                for row in rows:
                    file.write(_line_of(row))
                    self.by_number[row.campaign] = row
        except OSError as error:
            raise WriteFailed(
                f"{self.path}: cannot be written ({error.strerror})",
                remedy="free space on the disk, then give the same command again: it goes on",
            ) from error

    def write(self) -> None:
        """Replace the file by all rows, by number; raise `WriteFailed`."""
        head = json.dumps(self.head, ensure_ascii=False) + "\n"
        lines = (_line_of(self.by_number[number]).decode() for number in sorted(self.by_number))
        replace_text(self.path, "".join([head, *lines]))

    def _read_lines(self) -> Iterator[bytes]:
        """Yield each line with its end; the last one may be cut off."""
        # Bounded, so that a large file without line ends, which is no table, does not fill memory.
        try:
            with open_file(self.path) as file:
                while line := file.readline(MOST_LINE_BYTES):
                    if len(line) == MOST_LINE_BYTES and not line.endswith(LINE_END):
                        raise OutputExists(
                            f"{self.path}: a line has more than {MOST_LINE_BYTES / MEGABYTE:g} MB, "
                            "the most that is read of one",
                            remedy=OTHER_FOLDER,
                        )
                    yield line
        except FileRefused as error:
            raise OutputExists(error.problem, remedy=error.remedy) from error

    def _check_head(self, line: bytes) -> None:
        """Raise `OutputExists` if the first line is not this study's head."""
        # Compared after a round through JSON, which turns tuples into lists. If it differs, say
        # the coarsest difference: another kind of file, other parameters, or anything else.
        try:
            head = from_json(line)
        except ValueError:
            head = None
        if head == json.loads(json.dumps(self.head)):
            return
        if not isinstance(head, dict) or head.get("schema") != self.head["schema"]:
            problem = "is no table of `pkmcal study` by this version"
        elif head.get("parameters") != list(self.head["parameters"]):
            problem = "belongs to a study of other parameters"
        else:
            problem = "belongs to another study: other plan, robots, noise, model or seed"
        raise OutputExists(f"{self.path}: {problem}", remedy=OTHER_FOLDER)


def _line_of(row: CampaignRow) -> bytes:
    return _ROWS.dump_json(row, exclude_none=True) + LINE_END
