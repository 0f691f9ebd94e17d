"""Odd files in the place of good ones: no refusal may be a crash, be slow, be large or be long.

A campaign is made, planned, measured in simulation, identified and exported. Each odd file then
stands in the place of one of its files, and every command that reads this file is given in a
process of its own. With `--times` all odd files are tried, and so many more drawn ones.
"""

import os
import random
import resource
import shutil
import signal
import sys
import tempfile
import unicodedata
from collections.abc import Callable
from importlib import import_module
from typing import NamedTuple

import pytest
from odd_files import ODD_NAMES, Oddity, drawn, no_files, of_csv, of_journal, of_yaml

from app.exits import Exit
from app.main import COMMANDS, run_command

pytestmark = [pytest.mark.torture, pytest.mark.long, pytest.mark.timeout(600)]

FIXED, DRAWN = 10, 3
"""Of each file's oddities that are not drawn every so many-th, and so many that are."""
MOST_SECONDS, MOST_MIB, MOST_CHARACTERS = 1.0, 200.0, 1000
HANGS_AFTER_S, PREPARED_WITHIN_S = 60, 600
"""By the wall's clock, as the machine may be busy with others."""
DESIGNED = frozenset({Exit.DONE, Exit.NOT_GOOD, Exit.BAD_INPUT, Exit.DEVICE, Exit.JOURNAL})
REFUSED = frozenset({Exit.BAD_INPUT, Exit.JOURNAL})
KIB = 1024
STEPS = ("new", "plan --shots 40", "run --yes", "identify", "export", "export --format shots")
TURNS = {"LRE", "RLE", "LRO", "RLO", "PDF", "LRI", "RLI", "FSI", "PDI"}


class Read(NamedTuple):
    """File of a campaign, the commands that read it, and what else it can be made of.

    In a command `{dir}` is the campaign's folder, `{new}` one that is not there yet. `keep` are
    files that must be there for it, beside campaign.yaml, robot.yaml and cell.yaml.
    """

    file: str
    commands: tuple[str, ...]
    specials: Callable[[bytes], tuple[Oddity, ...]]
    keep: tuple[str, ...] = ()


IMPORT = "import {{dir}} {{dir}}/points.txt --format ascii --unit mm --joints {}"
LOADS = ("load {dir} --dry", "load {dir} --dry --robot {dir}/robot-compensated.yaml")
RUNS = ("validate {dir} --stage before --dry", "devices {dir}", "run {dir} --dry")
MAKES = ("run {dir} --dry", "new {new} --robot {dir}/robot.yaml")
SHOTS = "import {dir} {dir}/shots.csv"
JOURNALS = ("export {dir} --format shots --to {new}.csv", "identify {dir}", SHOTS)
READS = (
    Read("campaign.yaml", RUNS, of_yaml, ("plan.csv",)),
    Read("robot.yaml", MAKES, of_yaml, ("plan.csv",)),
    Read("robot-compensated.yaml", LOADS, of_yaml, ("campaign.db", "cell-memory.json")),
    Read("cell.yaml", ("devices {dir}", "new {new} --scenario {dir}/cell.yaml"), of_yaml),
    Read("plan.csv", ("run {dir} --dry",), of_csv),
    Read("shots.csv", (SHOTS,), of_csv),
    Read("points.txt", (IMPORT.format("{dir}/joints.csv"),), of_csv, ("joints.csv",)),
    Read("joints.csv", (IMPORT.format("{dir}/joints.csv"),), of_csv, ("points.txt",)),
    Read("campaign.db", JOURNALS, of_journal, ("shots.csv",)),
)
ALWAYS = ("campaign.yaml", "robot.yaml", "cell.yaml")
NAMED = (
    *("devices {name}", "export {name}", "import {dir} {name}", IMPORT.format("{name}")),
    *("load {dir} --dry --robot {name}", "new {new} --robot {name}"),
    *("new {new} --scenario {name}", "sim {name}"),
)
"""Commands to which the name of a file or folder to read is given."""


class Trial(NamedTuple):
    """How one command on something odd ended; seconds are the processor's."""

    what: str
    code: int
    seconds: float
    peak_mib: float
    error: str

    def faults(self, own_mib: float) -> list[str]:
        """What must not be; of the memory what this process held before is no fault."""
        lines = self.error.splitlines() or [""]
        is_unclear = not lines[-1].startswith("pkmcal: ") or " → " not in lines[-1]
        if self.code in {Exit.DONE, Exit.NOT_GOOD}:
            return []
        checks = {
            f"exit code {self.code}": self.code not in DESIGNED,
            f"refused after {self.seconds:.1f} s": self.seconds > MOST_SECONDS,
            f"refused with {self.peak_mib:.0f} MiB": self.peak_mib > MOST_MIB + own_mib,
            "no error line with a remedy": is_unclear,
            f"an error line of {len(lines[-1])} characters": len(lines[-1]) > MOST_CHARACTERS,
            "shows control characters": any(map(is_unclean, self.error)),
        }
        return [
            f"{self.what}: {name}: {self.error[-200:]!r}" for name, is_so in checks.items() if is_so
        ]


def is_unclean(sign: str) -> bool:
    is_control = unicodedata.category(sign) in {"Cc", "Cs", "Zl", "Zp"} and sign != "\n"
    return is_control or unicodedata.bidirectional(sign) in TURNS


def trial(command: str, what: str, patience_s: int = HANGS_AFTER_S, **names) -> Trial:
    """Give a command in a process of its own, and look how that ends."""
    words = [word.format(**names) for word in command.split()]
    with tempfile.TemporaryFile() as output:
        child = os.fork()
        if child == 0:
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            signal.alarm(patience_s)  # and it is killed
            become_the_program(words, output.fileno())
        _, status, usage = os.wait4(child, 0)
        output.seek(0)
        error = output.read().decode("utf-8", errors="surrogateescape")
    seconds, code = usage.ru_utime + usage.ru_stime, os.waitstatus_to_exitcode(status)
    return Trial(f"{what} · {command}", code, seconds, usage.ru_maxrss / KIB, error)


def become_the_program(words: list[str], output: int) -> None:
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
        code = run_command(words)
        sys.stdout.flush()
        sys.stderr.flush()
    finally:
        os._exit(code)


def tried(base, folder, read: Read, oddity: Oddity) -> list[Trial]:
    """Give each command that reads the file, with the odd one in its place."""
    trials = []
    for command in read.commands:
        folder.mkdir()
        for name in {*ALWAYS, *read.keep} - {read.file}:
            shutil.copyfile(base / name, folder / name)
        oddity.put(folder / read.file)
        what = f"{read.file} · {oddity.name}"
        trials.append(trial(command, what, dir=folder, new=folder / "new"))
        shutil.rmtree(folder)
    return trials


@pytest.fixture(scope="module")
def base(tmp_path_factory):
    """A campaign in which everything was done, with every file that a command may read."""
    folder = tmp_path_factory.mktemp("odd") / "base"
    for module, _ in COMMANDS.values():  # a child would import them anew: its time is its work's
        import_module(f"app.cli.{module}")
    for step in STEPS:
        command, *options = step.split()
        done = trial(" ".join([command, "{dir}", *options]), "", PREPARED_WITHIN_S, dir=folder)
        assert done.code == Exit.DONE, done
    write_points(folder)
    return folder


def write_points(folder):
    """The same shots as points of other software and a file of joints."""
    header, *rows = (line.split(",") for line in (folder / "shots.csv").read_text().splitlines())
    axes = [header.index(f"{axis}_mm") for axis in "xyz"]
    keys = [header.index(key) for key in ("q0_deg", "q1_deg", "q2_deg", "q3_deg", "pair", "set")]
    points = [f"P{number} {' '.join(row[at] for at in axes)}" for number, row in enumerate(rows)]
    joints = [",".join([f"P{n}", *(row[at] for at in keys)]) for n, row in enumerate(rows)]
    (folder / "points.txt").write_text("\n".join(points) + "\n")
    heading = "name,q0_deg,q1_deg,q2_deg,q3_deg,pair,set"
    (folder / "joints.csv").write_text("\n".join([heading, *joints]) + "\n")


def harm(trials: list[Trial]) -> list[str]:
    own_mib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / KIB
    return [fault for each in trials for fault in each.faults(own_mib)]


@pytest.mark.parametrize("read", READS, ids=lambda read: read.file)
def test_no_odd_file_does_harm(base, tmp_path, read, times):
    data = (base / read.file).read_bytes()
    fixed = (*no_files(), *read.specials(data))
    rng = random.Random(read.file)
    some = fixed if times > 1 else fixed[rng.randrange(FIXED) :: FIXED]
    others = [(base / each.file).read_bytes() for each in READS]
    odd = [*some, *(drawn(data, others, rng) for _ in range(DRAWN * times))]
    trials = [each for one in odd for each in tried(base, tmp_path / "tried", read, one)]
    assert len(trials) == len(odd) * len(read.commands)
    assert harm(trials) == []
    assert {each.code for each in trials} & REFUSED


def test_no_odd_name_does_harm(base, tmp_path, times):
    new, trials = tmp_path / "named", []
    for name in ODD_NAMES[:: 4 if times == 1 else 1]:
        for command in NAMED:
            trials.append(trial(command, repr(name[:40]), dir=base, new=new, name=name))
            shutil.rmtree(new, ignore_errors=True)
    assert harm(trials) == []
