"""pybotics in an environment and a process of its own: it needs an older NumPy than ours may be.

The environment is made once, by pip, in a folder that git ignores.
"""

import json
import subprocess
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

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
    """Takes part, a round a call: the cost of a calibration, and its largest unseen error, mm.

    Raises `RivalMissing` when the process has ended.
    """

    process: "subprocess.Popen[bytes]"
    versions: str

    def __call__(self) -> Run[float]:
        assert self.process.stdin is not None
        try:
            self.process.stdin.write(b"once more\n")
        except BrokenPipeError as error:
            raise RivalMissing("its process has ended") from error
        told = _next_answer(self.process)
        return Run(float(told["seconds"]), float(told["unseen_max_mm"]))


@contextmanager
def taking_part(command: Sequence[str | Path]) -> Iterator[Pybotics]:
    """The process of this command; raises `RivalMissing` when it ends without a word."""
    pipe = subprocess.PIPE  # unbuffered: nothing may be left to be flushed to one that has ended
    with subprocess.Popen(
        command, bufsize=0, stdin=pipe, stdout=pipe, stderr=subprocess.DEVNULL
    ) as process:
        try:
            told = _next_answer(process)
            yield Pybotics(process, ", ".join(f"{name} {told[name]}" for name in told))
        finally:
            process.terminate()


def _next_answer(process: "subprocess.Popen[bytes]") -> dict[str, Any]:
    assert process.stdout is not None
    line = process.stdout.readline()
    if not line:
        raise RivalMissing("its process has ended")
    return dict(json.loads(line))


def command_line(cache: Path = CACHE) -> tuple[Path, str, Path]:
    """What starts the recipe, installed first if need be; raises `RivalMissing`."""
    folder = cache / f"{REQUIREMENT}-python{sys.version_info.major}.{sys.version_info.minor}"
    python = folder / "bin" / "python"
    steps: tuple[tuple[str | Path, ...], ...] = (
        (sys.executable, "-m", "venv", "--clear", folder),
        (python, "-m", "pip", "install", "--retries=1", "--only-binary=:all:", REQUIREMENT),
    )
    if not (folder / COMPLETE).exists():
        try:
            for step in steps:
                subprocess.run(step, check=True, capture_output=True, timeout=STEP_S)
        except (OSError, subprocess.SubprocessError) as error:
            written = (getattr(error, "stderr", None) or b"").decode("utf-8", "replace").strip()
            reason = (written or str(error)).splitlines()[-1]
            raise RivalMissing(f"{REQUIREMENT} could not be installed: {reason}") from error
        (folder / COMPLETE).touch()
    return python, "-I", RECIPE
