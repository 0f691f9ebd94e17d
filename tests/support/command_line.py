"""The command line as its users see it: a command in, exit code and both streams out."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

from ruamel.yaml import YAML

from app.main import run_command

PKMCAL = (sys.executable, "-m", "app.main")
PREFIX = "pkmcal: "
SMALL_TESTS = {
    "validation.repeatability_approaches": 3,
    "validation.rotation_steps": 3,
    "validation.line_points": 3,
}
"""Settings of a campaign's tests that are soon measured."""
SMALL = {"acceptance": {}, "plan.shots": 24, "plan.validation_pairs": 3, **SMALL_TESTS}
"""33 shots: identification, three unseen pairs and three of drift."""
FAST = {
    "speed_up": 1000,
    "controller.computes_plate_tilt": True,
    "controller.computes_transmission": True,
}
"""A controller that can be given all that is identified."""
UNTOUCHED = ("campaign.lock", "campaign.db-wal", "campaign.db-shm")
"""Files that come and go with any work, and hold nothing of it."""


class Ended(NamedTuple):
    """How a command ended."""

    code: int
    out: str
    err: str

    @property
    def error_line(self):
        """The one error line, which is the last thing said."""
        lines = self.err.splitlines()
        assert [line for line in lines if line.startswith(PREFIX)] == lines[-1:], self.err
        assert "Traceback" not in self.err
        assert " → " in lines[-1], "what to do next"
        return lines[-1].removeprefix(PREFIX)

    @property
    def document(self):
        """The one JSON document on stdout."""
        return json.loads(self.out)


class CommandLine:
    """Runs commands in this process."""

    def __init__(self, capsys):
        self._capsys = capsys

    def __call__(self, *arguments):
        self._capsys.readouterr()
        code = run_command([str(argument) for argument in arguments])
        captured = self._capsys.readouterr()
        return Ended(int(code), captured.out, captured.err)


class Keyboard:
    """Somebody at a terminal who types this and leaves."""

    def __init__(self, typed):
        self._typed, hand = os.pipe()
        os.write(hand, typed.encode())
        os.close(hand)

    def fileno(self):
        return self._typed

    def isatty(self):
        return True


def started(*arguments, **options):
    """The same in a process of its own, still running; it heeds SIGHUP also under `nohup`."""
    heeded = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    try:
        return subprocess.Popen(
            [*PKMCAL, *map(str, arguments)],
            stdin=options.pop("stdin", subprocess.DEVNULL),
            stdout=options.pop("stdout", subprocess.PIPE),
            stderr=options.pop("stderr", subprocess.PIPE),
            text=True,
            **options,
        )
    finally:
        signal.signal(signal.SIGHUP, heeded)


def ended(process, within_s=20.0):
    """Wait for it."""
    out, err = process.communicate(timeout=within_s)
    return Ended(process.returncode, out, err or "")


def change(path: Path, settings: Mapping[str, object]):
    """Set keys of a YAML file, named like `plan.shots`, and make their sections; None deletes."""
    yaml = YAML()
    tree = yaml.load(path.read_text(encoding="utf-8"))
    for name, value in settings.items():
        *sections, key = (int(step) if step.isdecimal() else step for step in name.split("."))
        section = tree
        for step in sections:
            section = section[step] if isinstance(step, int) else section.setdefault(step, {})
        if value is None and not isinstance(key, int):
            section.pop(key, None)  # new files do not show all keys
        elif value is None:
            del section[key]
        else:
            section[key] = value
    with path.open("w", encoding="utf-8") as file:
        yaml.dump(tree, file)


def ran(folder: Path, *commands: str) -> None:
    for words in commands:
        name, *options = words.split()
        assert run_command([name, str(folder), *options]) == 0, words


def make_planned(folder: Path) -> None:
    """Make a campaign on a small, fast simulated cell, with its plan."""
    ran(folder, "new --scenario paper-simulation")
    change(folder / "campaign.yaml", SMALL)
    change(folder / "cell.yaml", FAST)
    ran(folder, "plan")


def contents(folder: Path):
    """Every file with its bytes, to see that nothing was changed."""
    return {
        path.name: path.read_bytes()
        for path in sorted(folder.iterdir())
        if path.name not in UNTOUCHED
    }
