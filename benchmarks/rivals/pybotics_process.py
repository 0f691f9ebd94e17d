"""pybotics in an environment and a process of its own: it needs an older NumPy than ours may be.

The environment is made once, by pip, in a folder that git ignores.
"""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from benchmarks.shared.rounds import Run

REQUIREMENT = "pybotics==3.1.2"
RECIPE = Path(__file__).with_name("pybotics_recipe.py")
CACHE = Path(__file__).parents[1] / ".cache"
COMPLETE = "complete"
"""A file that an environment gets when everything is installed in it."""
STEP_S = 300.0
"""For making an environment, and for installing."""


class RivalMissing(Exception):
    """A rival that cannot take part, and why, in one line."""


@dataclass(frozen=True, slots=True)
class Pybotics:
    """Takes part, a round a call."""

    versions: str
    questions: IO[bytes]
    answers: IO[bytes]

    def __call__(self) -> Run[float]:
        """The cost of a calibration, and its largest error on unseen points, mm.

        Raises `RivalMissing` when the process has ended.
        """
        try:
            self.questions.write(b"once more\n")
        except BrokenPipeError as error:
            raise RivalMissing("its process has ended") from error
        told = _next_answer(self.answers)
        return Run(float(told["seconds"]), float(told["unseen_max_mm"]))


@contextmanager
def taking_part(command: Sequence[str | Path]) -> Iterator[Pybotics]:
    """The process of this command; raises `RivalMissing` when it ends without a word."""
    with subprocess.Popen(
        command,
        bufsize=0,  # nothing may be left to be flushed to a process that has ended
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    ) as process:
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            told = _next_answer(process.stdout)
            versions = ", ".join(f"{name} {number}" for name, number in told.items())
            yield Pybotics(versions, process.stdin, process.stdout)
        finally:
            process.terminate()


def _next_answer(answers: IO[bytes]) -> dict[str, str | float]:
    line = answers.readline()
    if not line:
        raise RivalMissing("its process has ended")
    return dict(json.loads(line))


def command_line() -> tuple[Path, str, Path]:
    """What starts the recipe, installed first if need be; raises `RivalMissing`."""
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    return environment(CACHE / f"{REQUIREMENT}-python{version}"), "-I", RECIPE


Execute = Callable[[Sequence[str | Path]], None]


def _execute(command: Sequence[str | Path]) -> None:
    subprocess.run(command, check=True, capture_output=True, timeout=STEP_S)


def environment(folder: Path, execute: Execute = _execute) -> Path:
    """The interpreter of the environment in a folder; raises `RivalMissing`."""
    python = folder / "bin" / "python"
    if (folder / COMPLETE).exists():
        return python
    try:
        execute([sys.executable, "-m", "venv", "--clear", folder])
        execute([python, "-m", "pip", "install", "--retries=1", "--only-binary=:all:", REQUIREMENT])
    except (OSError, subprocess.SubprocessError) as error:
        raise RivalMissing(f"{REQUIREMENT} could not be installed: {_reason(error)}") from error
    (folder / COMPLETE).touch()
    return python


def _reason(error: OSError | subprocess.SubprocessError) -> str:
    """One line: the last that the command wrote about its failure, else the failure itself."""
    written = getattr(error, "stderr", None) or b""
    lines = written.decode("utf-8", "replace").strip().splitlines()
    return lines[-1] if lines else str(error)
