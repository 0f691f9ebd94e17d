"""Every reader of files on odd files: no refusal may be a crash, be slow, be large or be long.

A campaign is made, planned, measured in simulation, identified and exported. Each odd file then
stands in the place of one of its files, and every command that reads this file is given in a
process of its own.
"""

import os
import shutil
import signal
import sys
import tempfile
import unicodedata
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from odd_files import Oddity, of_csv, of_journal, of_json, of_yaml

from app.exits import Exit
from app.main import COMMANDS, run_command

MOST_SECONDS, MOST_MIB, MOST_CHARACTERS = 1.0, 200.0, 1000
HANGS_AFTER_S = 60
PREPARED_WITHIN_S = 600
"""By the wall's clock, as the machine may be busy with others."""
DESIGNED = frozenset({Exit.DONE, Exit.NOT_GOOD, Exit.BAD_INPUT, Exit.DEVICE, Exit.JOURNAL})
REFUSED = frozenset({Exit.BAD_INPUT, Exit.JOURNAL})
KIB = 1024
IMPORT = "import {{dir}} {{dir}}/points.txt --format ascii --unit mm --joints {}"
Specials = Callable[[bytes], tuple[Oddity, ...]]


@dataclass(frozen=True, slots=True)
class Read:
    """File of a campaign, the commands that read it, and what else it can be made of.

    In a command `{dir}` is the campaign's folder, `{new}` one that is not there yet.
    """

    file: str
    commands: tuple[str, ...]
    specials: Specials
    keep: tuple[str, ...] = ()
    """Files that must be there for it, beside campaign.yaml, robot.yaml and cell.yaml."""


PLAN = ("plan.csv",)
READS = (
    Read(
        "campaign.yaml",
        ("validate {dir} --stage before --dry", "devices {dir}", "run {dir} --dry"),
        of_yaml,
        PLAN,
    ),
    Read("robot.yaml", ("run {dir} --dry", "new {new} --robot {dir}/robot.yaml"), of_yaml, PLAN),
    Read(
        "robot-compensated.yaml",
        ("load {dir} --dry", "load {dir} --dry --robot {dir}/robot-compensated.yaml"),
        of_yaml,
        ("campaign.db", "cell-memory.json"),
    ),
    Read("cell.yaml", ("devices {dir}", "new {new} --scenario {dir}/cell.yaml"), of_yaml),
    Read("cell-memory.json", ("devices {dir}",), of_json),
    Read("plan.csv", ("run {dir} --dry",), of_csv),
    Read("shots.csv", ("import {dir} {dir}/shots.csv",), of_csv),
    Read("points.txt", (IMPORT.format("{dir}/joints.csv"),), of_csv, ("joints.csv",)),
    Read("joints.csv", (IMPORT.format("{dir}/joints.csv"),), of_csv, ("points.txt",)),
    Read(
        "campaign.db",
        (
            "export {dir} --format shots --to {new}.csv",
            "identify {dir}",
            "import {dir} {dir}/shots.csv",
        ),
        of_journal,
        ("shots.csv",),
    ),
)
ALWAYS = ("campaign.yaml", "robot.yaml", "cell.yaml")
NAMED = (
    "devices {name}",
    "export {name}",
    "import {dir} {name}",
    IMPORT.format("{name}"),
    "load {dir} --dry --robot {name}",
    "new {new} --robot {name}",
    "new {new} --scenario {name}",
    "sim {name}",
)
"""Commands to which the name of a file or folder to read is given."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One command on one odd file, and how it ended."""

    file: str
    oddity: str
    command: str
    code: int
    seconds: float
    """Of the processor, after the start of the program."""
    peak_mib: float
    error: str

    def __str__(self) -> str:
        return f"{self.file} · {self.oddity} · {self.command} · {self.error[-200:]!r}"

    def faults(self, most_mib: float) -> Iterator[str]:
        """What must not be; `most_mib` is with what the process held before."""
        if self.code not in DESIGNED:
            yield f"exit code {self.code}"
        if self.code not in {Exit.DONE, Exit.NOT_GOOD}:
            if self.seconds > MOST_SECONDS:
                yield f"refused after {self.seconds:.1f} s"
            if self.peak_mib > most_mib:
                yield f"refused with {self.peak_mib:.0f} MiB"
            yield from _faults_of_line(self.error)


def _faults_of_line(error: str) -> Iterator[str]:
    lines = error.splitlines()
    last = lines[-1] if lines else ""
    if not last.startswith("pkmcal: ") or " → " not in last:
        yield f"no error line with a remedy, but {last[:80]!r}"
    if len(last) > MOST_CHARACTERS:
        yield f"an error line of {len(last)} characters"
    signs = {unicodedata.name(sign, hex(ord(sign))) for sign in error if _is_unclean(sign)}
    if signs:
        yield f"shows {', '.join(sorted(signs))}"


def _is_unclean(sign: str) -> bool:
    is_control = unicodedata.category(sign) in {"Cc", "Cs", "Zl", "Zp"} and sign != "\n"
    return is_control or unicodedata.bidirectional(sign) in {
        *("LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI")
    }


def odd_names(base: Path, folder: Path, names: Sequence[str]) -> Iterator[Trial]:
    """Trials of names that no file of a campaign has."""
    for name in names:
        for command in NAMED:
            new = folder / "named"
            words = [word.format(dir=base, new=new, name=name) for word in command.split()]
            yield trial(words, "(name)", repr(name[:40]), command)
            shutil.rmtree(new, ignore_errors=True)


def tried(base: Path, folder: Path, read: Read, oddity: Oddity) -> Iterator[Trial]:
    """Each command that reads the file, with the odd one in its place."""
    for command in read.commands:
        folder.mkdir()
        try:
            for name in {*ALWAYS, *read.keep} - {read.file}:
                shutil.copyfile(base / name, folder / name)
            path = folder / read.file
            path.parent.mkdir(exist_ok=True)
            oddity.put(path)
            words = [word.format(dir=folder, new=folder / "new") for word in command.split()]
            yield trial(words, read.file, oddity.name, command)
        finally:
            shutil.rmtree(folder)


def trial(
    words: Sequence[str], file: str, oddity: str, command: str, patience_s: int = HANGS_AFTER_S
) -> Trial:
    """Give a command in a process of its own, and look how that ends."""
    with tempfile.TemporaryFile() as output:
        child = os.fork()
        if child == 0:
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.alarm(patience_s)  # and it is killed
            _become_the_program(words, output.fileno())
        _, status, usage = os.wait4(child, 0)
        output.seek(0)
        error = output.read().decode("utf-8", errors="surrogateescape")
    seconds = usage.ru_utime + usage.ru_stime
    code = os.waitstatus_to_exitcode(status)
    return Trial(file, oddity, command, code, seconds, usage.ru_maxrss / KIB, error)


def _become_the_program(words: Sequence[str], output: int) -> None:
    """End as the program does, whatever happens; what it says on stderr goes into the file."""
    code = 99
    try:
        nothing = os.open(os.devnull, os.O_RDWR)
        os.dup2(nothing, 0)
        os.dup2(nothing, 1)
        os.dup2(output, 2)
        sys.stdin = open(0, encoding="utf-8", closefd=False)  # noqa: SIM115
        sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
        sys.stderr = open(2, "w", encoding="utf-8", closefd=False)  # noqa: SIM115
        code = run_command(list(words))
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)


def prepare(base: Path) -> None:
    """A campaign in which everything was done, with every file that a command may read."""
    for module, _ in COMMANDS.values():  # a child would import them anew: its time is its work's
        import_module(f"app.cli.{module}")
    for step in (
        "new",
        "plan --shots 40",
        "run --yes",
        "identify",
        "export",
        "export --format shots",
    ):
        command, *options = step.split()
        done = trial([command, str(base), *options], "", "", step, PREPARED_WITHIN_S)
        if done.code != Exit.DONE:
            raise RuntimeError(f"{step}: exit code {done.code}: {done.error}")
    _write_points(base)


def _write_points(base: Path) -> None:
    """The same shots as points of other software and a file of joints."""
    header, *rows = (line.split(",") for line in (base / "shots.csv").read_text().splitlines())
    joints = [header.index(f"q{joint}_deg") for joint in range(4)]
    axes = [header.index(f"{axis}_mm") for axis in "xyz"]
    keys = [header.index(key) for key in ("pair", "set")]
    points = [f"P{number} {' '.join(row[at] for at in axes)}" for number, row in enumerate(rows)]
    values = [
        ",".join([f"P{number}", *(row[at] for at in (*joints, *keys))])
        for number, row in enumerate(rows)
    ]
    (base / "points.txt").write_text("\n".join(points) + "\n")
    heading = "name,q0_deg,q1_deg,q2_deg,q3_deg,pair,set"
    (base / "joints.csv").write_text("\n".join([heading, *values]) + "\n")
