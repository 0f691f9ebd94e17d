"""Programs that state a mechanism (`my.py:OWN`): read within bounds, and run only if trusted.

A robot file is data, but the Python file that it may name is a program, which can do whatever its
user can. Folders of campaigns are sent around. So a program runs only if the user's list, which is
in no such folder, has the sha256 of its bytes. These very bytes are compiled: no file of a cache
and no later version of the file runs in their place.
"""

import hashlib
import os
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import FrameType, ModuleType

from campaigns.errors import ConfigInvalid
from campaigns.files.text_file import make_folder, replace_text
from campaigns.kinematics import catalog
from campaigns.kinematics.mechanism import Mechanism
from drivers.bounded_files import MEGABYTE, FileMissing, FileRefused, decoded, read_bounded
from drivers.texts import printable

PYTHON = ".py"
LONGEST_RUN_S = 30.0
"""Time in which a program must have assigned its mechanism; imports of SciPy take a second."""


@dataclass(frozen=True, slots=True)
class Program:
    """Python file with the bytes that it had when it was read."""

    path: Path
    code: bytes

    @classmethod
    def read(cls, path: Path) -> "Program":
        """Read a file; raise `ConfigInvalid` for one that is missing, no file, or too large."""
        try:
            return cls(path, read_bounded(path, MEGABYTE))
        except FileRefused as error:
            raise ConfigInvalid(error.problem, remedy=error.remedy) from error

    @property
    def sha256(self) -> str:
        """Digest of the bytes."""
        return hashlib.sha256(self.code).hexdigest()


class ProgramUntrusted(ConfigInvalid):
    """A mechanism's program is not on this user's list: read it, then trust it."""

    def __init__(self, program: Program) -> None:
        super().__init__(
            f"{program.path} is a program that came with this folder (sha256 {program.sha256})",
            remedy=f"read it, then `pkmcal trust {program.path}`",
        )
        self.program = program


def list_path() -> Path:
    """Return the path of the user's list of trusted programs."""
    # the place by the XDG rules; a relative one would be another one in each folder
    stated = os.environ.get("XDG_CONFIG_HOME", "")
    folder = Path(stated) if Path(stated).is_absolute() else Path("~/.config").expanduser()
    return folder / "pkmcal" / "trusted"


def trusted_programs() -> dict[str, str]:
    """Return the paths of the trusted programs, as they were trusted, by sha256.

    Raise `ConfigInvalid` for a list that cannot be read.
    """
    path = list_path()
    try:
        text = decoded(read_bounded(path, MEGABYTE), str(path))
    except FileMissing:
        return {}
    except FileRefused as error:
        raise ConfigInvalid(error.problem, remedy=error.remedy) from error
    rows = (line.split(maxsplit=1) for line in text.split("\n"))
    return {row[0]: row[1] for row in rows if len(row) == 2}


def trust(program: Program) -> None:
    """Put a program on the user's list; raise `WriteFailed`."""
    _write({**trusted_programs(), program.sha256: str(program.path.absolute())})


def withdraw(program: Program) -> bool:
    """Take a program off the user's list; return whether it was on it."""
    programs = trusted_programs()
    was_trusted = programs.pop(program.sha256, None) is not None
    if was_trusted:
        _write(programs)
    return was_trusted


def _write(programs: dict[str, str]) -> None:
    """Write the list in the form of sha256sum, so that `sha256sum --check` compares it."""
    path = list_path()
    make_folder(path.parent)
    # a name with a line break would put a second line, of another program, on the list
    lines = (f"{sha256}  {printable(name)}\n" for sha256, name in programs.items())
    replace_text(path, "".join(lines))


def program_of(word: object, folder: Path) -> Program | None:
    """Return the program that a robot file in a folder names as `FILE.py:NAME`; None for a word.

    Raise `ConfigInvalid` for a file outside the folder, or one that cannot be read.
    """
    file, _, _ = str(word).rpartition(":")
    if not file.endswith(PYTHON):
        return None
    path = folder / file
    try:
        is_inside = path.resolve().is_relative_to(folder.resolve())
    except (OSError, RuntimeError, ValueError):  # links in a circle, a NUL in the name
        is_inside = False
    if not is_inside:
        raise ConfigInvalid(
            f"{path}: a mechanism's program must be in the folder of its robot file",
            remedy="put the file beside the robot file, and name it without a path",
        )
    return Program.read(path)


def find_mechanism(word: object, folder: Path) -> Mechanism | None:
    """Return a mechanism by its word: shipped, a trusted program's, or another package's.

    Return None for an unknown word. Raise `ProgramUntrusted`, and `ConfigInvalid`, `ImportError`,
    `AttributeError` or `TypeError` where a program or package gives no mechanism of that name.
    """
    program = program_of(word, folder)
    if program is None:
        return catalog.find_mechanism(word)
    if program.sha256 not in trusted_programs():
        raise ProgramUntrusted(program)
    name = str(word).rpartition(":")[2]
    mechanism = getattr(_run(program), name)
    if not isinstance(mechanism, Mechanism):
        raise TypeError(f"{name} in {program.path} is {mechanism!r}, must be a Mechanism")
    return mechanism


def _run(program: Program) -> ModuleType:
    """Run a program as a module and return it; raise `ImportError` whatever it raises."""
    module = ModuleType(program.path.stem)
    module.__file__ = str(program.path)
    try:
        with _limited(LONGEST_RUN_S):
            exec(compile(program.code, program.path, "exec"), vars(module))  # noqa: S102 - trusted
    except KeyboardInterrupt:
        raise
    except BaseException as error:  # other people's code may raise anything, SystemExit too
        raise ImportError(f"{program.path}: {type(error).__name__} {error}") from error
    return module


class _TooLong(BaseException):
    """End of a program that goes on for too long; no `except Exception` in it holds this up."""


@contextmanager
def _limited(limit_s: float) -> Iterator[None]:
    """End a block that takes longer than a limit by `_TooLong`, in the main thread alone.

    Other threads take no signals. They read only what the main thread has read before them.
    Windows has no timer that ends a block: there Ctrl-C does.
    """
    has_timer = hasattr(signal, "setitimer")
    if not has_timer or threading.current_thread() is not threading.main_thread():
        yield
        return

    def end(signum: int, frame: FrameType | None) -> None:  # noqa: ARG001 - a handler's signature
        raise _TooLong(f"it was not done after {limit_s:g} s")

    handler = signal.signal(signal.SIGALRM, end)
    remaining_s, interval_s = signal.setitimer(signal.ITIMER_REAL, limit_s, 1.0)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, handler)
        signal.setitimer(signal.ITIMER_REAL, remaining_s, interval_s)
