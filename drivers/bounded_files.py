"""Files as texts, and YAML in them, within bounds: what is too much is refused before it is read.

A file of the right name may be a folder, a pipe that no one writes, a device without an end, 50 GB,
or ten lines of YAML that stand for a billion. Such a file is refused in bounded time and memory.
"""

import codecs
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, Literal

from ruamel.yaml import YAML
from ruamel.yaml.composer import Composer
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.events import AliasEvent

from drivers.errors import ExplainedError
from drivers.texts import printable, shortened

Encoding = Literal["utf-8", "utf-16", "cp1252"]
SAVE_AS_UTF8 = "save the file as plain text in UTF-8"

MEGABYTE = 1_000_000
YAML_BYTES = MEGABYTE
CSV_BYTES = 20 * MEGABYTE
YAML_LINES = 20_000
YAML_ENTRIES = 10_000
YAML_DEPTH = 30
"""Keys, values and list entries, lines, and levels: dozens of times what any file of ours has."""
PROBLEM_CHARACTERS = 200
_KINDS = (
    (stat.S_ISDIR, "a folder"),
    (stat.S_ISFIFO, "a pipe"),
    (stat.S_ISSOCK, "a socket"),
    (lambda mode: stat.S_ISCHR(mode) or stat.S_ISBLK(mode), "a device"),
)
_AS_CSV = "save the sheet as CSV (UTF-8), and give that file"
_NO_TEXTS = (
    (b"PK\x03\x04", "a workbook of a spreadsheet, or another zip archive", _AS_CSV),
    (b"\xd0\xcf\x11\xe0", "a workbook of an old spreadsheet", _AS_CSV),
    (b"\x1f\x8b", "compressed (gzip)", "unpack it first: gunzip FILE"),
    (b"BZh", "compressed (bzip2)", "unpack it first: bunzip2 FILE"),
    (b"\xfd7zXZ", "compressed (xz)", "unpack it first: unxz FILE"),
    (b"7z\xbc\xaf", "compressed (7z)", "unpack it first"),
    (b"Rar!", "compressed (rar)", "unpack it first"),
    (b"\x28\xb5\x2f\xfd", "compressed (zstd)", "unpack it first: unzstd FILE"),
    (b"%PDF-", "a PDF", "export the points as text"),
    (b"SQLite format 3\0", "a database", "export the points as text"),
)
"""First bytes of files that are no text, what they are, and what to do."""


class FileRefused(ExplainedError):
    """A file that cannot be read as what it should be: look at it, or name another."""


class FileMissing(FileRefused):
    """There is no such file."""


def is_file(path: Path) -> bool:
    """Return whether a file is visible by this name; never raise, whatever the name."""
    try:
        return path.is_file()
    except (OSError, ValueError):  # too long, in a circle, in a folder that is not for us
        return False


def is_there(path: Path) -> bool:
    """Return whether anything is visible by this name; never raise, whatever the name."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def read_bounded(path: Path, most_bytes: int) -> bytes:
    """Read a file; raises `FileRefused`, before reading when it is no file or too large."""
    # One byte more than allowed shows that there are more. The size that `stat` reports would not
    # do: files of /proc report 0, and a file may grow meanwhile.
    with open_file(path) as file:
        data = file.read(most_bytes + 1)
    if len(data) > most_bytes:
        raise FileRefused(
            f"{path}: has more than {most_bytes / MEGABYTE:g} MB, the most that is read of it",
            remedy="check that it is the right file",
        )
    return data


@contextmanager
def open_file(path: Path) -> Iterator[BinaryIO]:
    """Open a file to be read; raises `FileRefused`, before reading when it is no file."""
    try:
        _check_kind(path)
        with path.open("rb") as file:
            yield file
    except FileNotFoundError as error:
        raise FileMissing(f"{path}: there is no such file", remedy="check its name") from error
    except (OSError, ValueError) as error:  # a ValueError is about a name with a NUL
        reason = (getattr(error, "strerror", None) or str(error)).lower()
        raise FileRefused(
            f"{path}: cannot be read ({reason})",
            remedy="check that it is a file and that this user may read it",
        ) from error


def _check_kind(path: Path) -> None:
    """Refuse what is no file before it is opened: opening a pipe waits for its writer."""
    mode = path.stat().st_mode
    if stat.S_ISREG(mode):
        return
    kind = next((words for is_one, words in _KINDS if is_one(mode)), "something else")
    raise FileRefused(f"{path}: is no file but {kind}", remedy="name a file, or take this away")


def decoded(
    data: bytes, name: str, encoding: Encoding | None = None, remedy: str = SAVE_AS_UTF8
) -> str:
    """Decode a text by its byte-order mark, else the encoding given, else UTF-8.

    Raises `FileRefused` naming the line of the first byte that cannot be read, or of a NUL.
    """
    check_is_text(data, name)
    codec = codec_of(data, encoding)
    try:
        text = data.decode(codec)
        check_no_nul(text, name, remedy)
        return text
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise FileRefused(
            f"{name}:{line}: byte 0x{data[error.start]:02x} is not "
            f"{codec.removesuffix('-sig').upper()} text",
            remedy=remedy,
        ) from error


# UTF-16 of Latin letters decodes as UTF-8 without an error, with a NUL beside each letter.
def check_no_nul(text: str, name: str, remedy: str) -> None:
    """Raise `FileRefused` for a text with NUL characters."""
    if "\0" in text:
        line = text.count("\n", 0, text.index("\0")) + 1
        raise FileRefused(
            f"{name}:{line}: has NUL characters: no text, or UTF-16 without a byte-order mark",
            remedy=remedy,
        )


def check_is_text(data: bytes, name: str) -> None:
    """Raise `FileRefused` for a file whose first bytes are those of another kind than text."""
    for begin, kind, remedy in _NO_TEXTS:
        if data.startswith(begin):
            raise FileRefused(f"{name}: is {kind}", remedy=remedy)


def codec_of(data: bytes, encoding: Encoding | None = None) -> str:
    """Return Python's name of the encoding of a text: without a mark UTF-16 must be given."""
    # A mark wins over the encoding given. Without one, UTF-16 is big endian if its first sign, of
    # which one byte is 0 in Latin text, begins with the 0.
    if data.startswith((codecs.BOM_UTF32_LE, codecs.BOM_UTF32_BE)):  # before its first half
        return "utf-32"
    if data.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        return "utf-16"
    if data.startswith(codecs.BOM_UTF8) or encoding in {None, "utf-8"}:
        return "utf-8-sig"
    if encoding == "cp1252":
        return "cp1252"
    return "utf-16-be" if data.startswith(b"\0") else "utf-16-le"


def loaded_yaml(yaml: YAML, text: str, name: str) -> object:
    """Parse a YAML text by a loader from `bounded`; raises `FileRefused` with the line."""
    if len(text) > YAML_BYTES or text.count("\n") > YAML_LINES:
        raise FileRefused(
            f"{name}: has more than {YAML_LINES} lines or {YAML_BYTES / MEGABYTE:g} MB",
            remedy="check that it is the right file",
        )
    try:
        tree: object = yaml.load(text)
    except MarkedYAMLError as error:
        raise _not_yaml(error, name) from error
    except (YAMLError, ValueError) as error:
        raise FileRefused(
            f"{name}: is not YAML: {_worded(str(error))}", remedy="correct the file"
        ) from error
    except (ArithmeticError, AssertionError, AttributeError, LookupError, RecursionError) as error:
        # what ruamel lets slip on unusual tags, numbers and directives, found by feeding it garbage
        raise FileRefused(
            f"{name}: has tags, directives or nesting that cannot be read",
            remedy="write plain keys, lists and values",
        ) from error
    return tree


def bounded(yaml: YAML) -> YAML:
    """Make a loader refuse aliases, deep nesting and too many entries, and return it."""
    yaml.max_depth = YAML_DEPTH
    yaml.Composer = _PlainComposer
    return yaml


class _PlainComposer(Composer):
    """Nodes of a file that says each thing where it stands."""

    # Any: the library's own types are not public
    def __init__(self, loader: Any = None) -> None:
        super().__init__(loader)
        self._entries = 0

    def compose_node(self, parent: Any, index: Any) -> Any:
        # Anchors and aliases let a few lines stand for a billion nodes ("billion laughs"), and no
        # file of ours needs them. Nodes are counted as they are composed, before they take memory.
        event = self.parser.peek_event()
        if isinstance(event, AliasEvent) or event.anchor is not None:
            raise MarkedYAMLError(
                problem="has & or *, anchors and aliases", problem_mark=event.start_mark
            )
        self._entries += 1
        if self._entries > YAML_ENTRIES:
            raise MarkedYAMLError(
                problem=f"has more than {YAML_ENTRIES} entries", problem_mark=event.start_mark
            )
        return super().compose_node(parent, index)


def _not_yaml(error: MarkedYAMLError, name: str) -> FileRefused:
    # Our own problems begin with "has", and the library's are recognised by their words.
    mark = error.problem_mark or error.context_mark
    where = f"{name}:{mark.line + 1}" if mark else name
    problem = _worded(str(error.problem or error.context))
    if problem.startswith("has "):
        return FileRefused(f"{where}: {problem}", remedy="write each value where it belongs")
    if "maximum depth" in problem:
        return FileRefused(
            f"{where}: is nested deeper than {YAML_DEPTH} levels",
            remedy="write plain keys, lists and values",
        )
    if "duplicate key" in problem:
        return FileRefused(f"{where}: {problem}", remedy="keep one of the two")
    return FileRefused(
        f"{where}: is not YAML: {problem}", remedy="correct the line, or the one before it"
    )


def _worded(problem: str) -> str:
    return shortened(printable(" ".join(problem.split())), PROBLEM_CHARACTERS)
