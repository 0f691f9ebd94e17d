"""Record what users of pkmcal rely on as plain files, and compare two such records in words.

python -m benchmarks.yardsticks FOLDER [--pkmcal PROGRAM] [--only PART] [--opens CAMPAIGN]
python -m benchmarks.yardsticks --compare OLD NEW [--most LINES]

Every figure comes from the command line in a process of its own: no code is shared with what is
measured, so `--pkmcal` may name the program of another checkout. FOLDER gets one file per case in
dry-runs, plans, identify, exports, commands, help, faults and old, the keys of all JSON documents,
and the folder `campaign`, which `--opens` gives to another version to read. Stamps, seconds,
digests and temporary folders are replaced by words: the same program writes the same files twice.
"""

import argparse
import html
import json
import os
import re
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

from ruamel.yaml import YAML

from benchmarks.differences import compare

DATA = Path(__file__).parents[1] / "tests" / "data"
ROBOTS = ("par4-prototype", "h4", "i4r", "i4l", "delta", "linear-delta")
SCENARIOS = ("paper-simulation", "realistic", "gears")
PAPER = ("--model", "paper", "--estimator", "distances")
FORMS: dict[str, tuple[str, ...]] = {"": (), "-standard": ("--model", "standard"), "-paper": PAPER}
REAL_SHOTS = ("table1-tracker-noise", "table2-repeatability")
"""Shots that are identified in all forms, the others in the first one."""
PARAMETER_FORMS = (
    *("yaml", "plain", "linuxcnc", "linuxcnc-rotarydelta", "linuxcnc-lineardelta"),
    *("klipper-rotary-delta", "klipper-delta", "urdf", "sdf", "klipper", "marlin", "reprap"),
)
EXPORTS = (
    "--format shots",
    *(f"--format {form}" for form in PARAMETER_FORMS),
    *(f"--joint-table {form}" for form in ("csv", "linuxcnc", "twincat")),
)
EXPORTED = ("par4-prototype", "delta", "linear-delta")
"""Robots whose dry run on `gears` is exported in every form."""
FAULTS = (
    *(f"at_measurement: 4, kind: {kind}, seconds: 3" for kind in ("beam_break", "wrong_target")),
    *(f"at_move: 4, kind: {kind}, seconds: 500" for kind in ("drive_fault", "stall")),
    "at_move: 4, kind: emergency_stop",
    *(
        f"device: {device}, at_answer: {at}, kind: {kind}, seconds: 8000"
        for device, at in (("controller", 16), ("tracker", 40))
        for kind in ("late", "silent", "garbage", "torn", "close")
    ),
    *(f"at_result: 4, kind: {kind}" for kind in ("early", "repeated", "straggling", "other_units")),
)
SMALL_PLAN: Mapping[str, Mapping[str, int]] = {
    "plan": {"shots": 8, "validation_pairs": 1, "drift_shots": 2},
    "settle": {"timeout_s": 300},
}
COMMANDS = """
check-journal DIR
status DIR
history DIR
devices DIR
advise DIR
identify DIR --model paper --estimator distances
identify DIR
correct DIR --poses poses.csv
run DIR --dry
load DIR --dry
load DIR --rollback --yes
load DIR --yes
validate DIR --stage after --only rotation --force --yes --retry 5
check DIR --dry
check DIR --yes --retry 5
study DIR --campaigns 4 --workers 1
report DIR
robot delta --base 200 --platform 45 --arm 300 --forearm 800
new offline --offline
new bad --robot nobody
"""
"""Commands on a finished campaign, in this order."""
OLD_FOLDERS = ("status", "check-journal", "history", "identify", "report")
POSES = "name,x_mm,y_mm,z_mm,theta_deg\nA,0,0,-600,0\nB,150,-100,-650,20\nC,-200,120,-550,-15\n"
DROPPED_KEYS = ("seconds", "at_utc", "latest_utc", "iterations", "covariance", "message")
STAMPS = (
    (r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)?( UTC|Z|\+00:00)?", "TIME"),
    (r"\b[0-9a-f]{64}\b", "DIGEST"),
    (r"\b[0-9a-f]{32}\b", "IDENTITY"),
    (r"\b[0-9a-f]{8,16}…", "DIGEST"),
    (r"127\.0\.0\.1:\d+", "127.0.0.1:PORT"),
    (r"\b0\.1\.\d+\b", "VERSION"),
)


@dataclass(frozen=True, slots=True)
class Answer:
    """Exit code and both streams of a command."""

    code: int
    out: str
    err: str

    def case(self) -> dict[str, Any]:
        """Return exit code, last line of an error, and the JSON document, if there is one."""
        error = self.err.strip().splitlines()[-1:] if self.code > 1 else []
        document = json.loads(self.out) if self.out.startswith(("{", "[")) else None
        return {"exit": self.code, "error": "".join(error), "document": document}


@dataclass(frozen=True, slots=True)
class Recorder:
    """Runs one program in a temporary folder, and writes its answers to another one."""

    program: Path
    work: Path
    to: Path

    def run(self, *words: str) -> Answer:
        own = {"COLUMNS": "100", "NO_COLOR": "1", "XDG_CACHE_HOME": str(self.work / "cache")}
        done = subprocess.run(
            [self.program, *words],
            cwd=self.work,
            env=os.environ | own | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            encoding="utf-8",
            check=False,
        )
        return Answer(done.returncode, done.stdout, done.stderr)

    def write(self, name: str, content: str | dict[str, Any]) -> None:
        """Write a text or a document without what differs between two runs."""
        if not isinstance(content, str):
            content = json.dumps(without_dropped(content), indent=1, ensure_ascii=False) + "\n"
        content = content.replace(str(self.work), "WORK")
        for pattern, word in STAMPS:
            content = re.sub(pattern, word, content)
        path = self.to / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(content, encoding="utf-8")


def without_dropped(value: Any) -> Any:
    if isinstance(value, dict):
        return {k: without_dropped(v) for k, v in value.items() if k not in DROPPED_KEYS}
    return [without_dropped(entry) for entry in value] if isinstance(value, list) else value


def report_tables(page: str) -> dict[str, list[str]]:
    """Return the rows of a report's tables by caption, cells joined by bars."""
    tables: dict[str, list[str]] = {}
    for table in re.findall(r"(?s)<table.*?</table>", page):
        caption, *rows = re.split(r"<tr\b[^>]*>", table)
        cells = [re.split(r"<t[dh]\b[^>]*>", row)[1:] for row in rows]
        lines = [" | ".join(map(plain_text, row)) for row in cells]
        tables.setdefault(plain_text(caption), []).extend(lines)
    return tables


def plain_text(markup: str) -> str:
    return " ".join(html.unescape(re.sub(r"<[^>]*>", " ", markup)).split())


def record_dry_run(recorder: Recorder, robot: str, scenario: str) -> None:
    """Record a dry run, its report and its exports; the first one also serves as old folder."""
    name = f"{robot}-{scenario}"
    folder = recorder.work / name
    case = recorder.run(
        "dry-run", str(folder), "--robot", robot, "--scenario", scenario, "--json"
    ).case()
    page = folder / "report.html"
    case["report"] = report_tables(page.read_text(encoding="utf-8")) if page.exists() else {}
    recorder.write(f"dry-runs/{name}.json", case)
    if scenario == "gears" and robot in EXPORTED:
        for words in EXPORTS:
            record_export(recorder, folder, f"{robot}-{file_name(words)}", words.split())
    if (robot, scenario) == (ROBOTS[0], SCENARIOS[0]):
        shutil.copytree(folder, recorder.to / "campaign", dirs_exist_ok=True)


def record_export(recorder: Recorder, folder: Path, name: str, words: Sequence[str]) -> None:
    """Record every file that an export writes, or its refusal."""
    old = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    answer = recorder.run("export", str(folder), *words, "--force", "--json")
    texts = [f"exit {answer.code}\n{answer.case()['error']}"]
    for path in sorted(folder.iterdir()):
        if path.stat().st_mtime_ns != old.get(path) and not path.name.startswith("campaign."):
            texts.append(f"== {path.name}\n{path.read_text(encoding='utf-8')}")
    recorder.write(f"exports/{name}.txt", "\n".join(texts))


def record_plans(recorder: Recorder, robot: str) -> None:
    """Record a plan at the boundary and an optimal one with their predicted σ."""
    optimal = ("--placement", "optimal", "--shots", "30")
    for placement, words in (("boundary", ()), ("optimal", optimal)):
        folder = recorder.work / f"plan-{robot}-{placement}"
        recorder.run("new", str(folder), "--robot", robot, "--scenario", "realistic")
        answer = recorder.run("plan", str(folder), *words, "--json")
        recorder.write(f"plans/{robot}-{placement}.json", answer.case())
        if (plan := folder / "plan.csv").exists():
            recorder.write(f"plans/{robot}-{placement}.csv", plan.read_text(encoding="utf-8"))


def record_identifications(recorder: Recorder, robot: str) -> None:
    """Record what is identified from the shots of known robots."""
    pattern = "vectors/*.csv" if robot == ROBOTS[0] else f"family/{robot}-[en]*.csv"
    for shots in sorted(DATA.glob(pattern)):
        folder = recorder.work / f"identify-{shots.stem}"
        recorder.run("new", str(folder), "--robot", robot)
        imported = recorder.run("import", str(folder), str(shots), "--json")
        recorder.write(f"identify/{shots.stem}-import.json", imported.case())
        for form, words in FORMS.items():
            if not form or shots.stem in REAL_SHOTS:
                answer = recorder.run("identify", str(folder), *words, "--json")
                recorder.write(f"identify/{shots.stem}{form}.json", answer.case())


def record_fault(recorder: Recorder, fault: str) -> None:
    """Record the sequence of the journal's records when a small run meets one fault."""
    name = file_name(fault)
    folder = recorder.work / f"fault-{name}"
    recorder.run("new", str(folder), "--scenario", "hostile")
    faults = f"faults:\n  - {{{fault}}}\n"
    edit(folder / "cell.yaml", {r"^faults:\n(?:[ -].*\n)*": faults})
    set_keys(folder / "campaign.yaml", SMALL_PLAN)
    planned = recorder.run("plan", str(folder))
    answer = recorder.run("run", str(folder), "--yes", "--retry", "5", "--json")
    lines = [f"plan: exit {planned.code}", f"run: exit {answer.code}", answer.case()["error"]]
    recorder.write(f"faults/{name}.txt", "\n".join([*lines, *story(folder / "campaign.db")]))


def set_keys(path: Path, sections: Mapping[str, Mapping[str, int]]) -> None:
    """Set keys of sections of a YAML file, also those that a new file does not show."""
    yaml = YAML()
    tree = yaml.load(path.read_text(encoding="utf-8"))
    for section, keys in sections.items():
        tree.setdefault(section, {}).update(keys)
    with path.open("w", encoding="utf-8") as file:
        yaml.dump(tree, file)


def edit(path: Path, changes: Mapping[str, str]) -> None:
    text = path.read_text(encoding="utf-8")
    for pattern, replacement in changes.items():
        text = re.sub(f"(?m){pattern}", replacement, text)
    path.write_text(text, encoding="utf-8")


def file_name(words: str) -> str:
    return re.sub(r"\W+", "-", words).strip("-")


def story(journal: Path) -> list[str]:
    """Return the journal's records as lines without numbers; shots in a row are one line."""
    with closing(sqlite3.connect(journal)) as connection:
        rows = connection.execute("SELECT kind, body FROM record ORDER BY id").fetchall()
    lines = []
    for kind, text in rows:
        body = json.loads(text)
        words = [str(body[key]) for key in ("kind", "how", "reason", "text") if body.get(key)]
        if kind == "intent":
            continue
        line = "measured" if kind == "outcome" else ": ".join([kind, *words])
        lines.append(re.sub(r"\d+(\.\d+)?", "#", re.sub(r"b'.*?'(?= |$|'$)", "BYTES", line)))
    return [line for line, _ in groupby(lines)]


def record_commands(recorder: Recorder) -> None:
    """Record the documents of all commands on one finished campaign, in a fixed order."""
    folder = recorder.work / "commands"
    recorder.run("dry-run", str(folder), "--scenario", "paper-simulation")
    (recorder.work / "poses.csv").write_text(POSES, encoding="utf-8")
    for line in COMMANDS.strip().splitlines():
        words = [str(folder) if word == "DIR" else word for word in line.split()]
        name = file_name(line.replace(" DIR", ""))
        recorder.write(f"commands/{name}.json", recorder.run(*words, "--json").case())


def record_helps(recorder: Recorder) -> None:
    """Record the help of the program and of each command that it lists."""
    text = recorder.run("--help").out
    recorder.write("help/pkmcal.txt", text)
    listed = text.partition("Commands:\n")[2].partition("\n\n")[0]
    for name in re.findall(r"(?m)^ {2}([a-z][\w-]*)", listed):
        recorder.write(f"help/{name}.txt", recorder.run(name, "--help").out)


def record_old(recorder: Recorder, opens: Path) -> None:
    """Record how journals and folders of older versions are read."""
    for name in ("journal-v1", "journal-v2", "campaign"):
        folder = recorder.work / f"old-{name}"
        if name == "campaign":
            shutil.copytree(opens, folder)
        else:
            recorder.run("new", str(folder))
            shutil.copy(DATA / f"{name}.db", folder / "campaign.db")
        for command in OLD_FOLDERS:
            answer = recorder.run(command, str(folder), "--json")
            recorder.write(f"old/{name}-{command}.json", answer.case())


def record_keys(recorder: Recorder) -> None:
    """Write the keys of all recorded documents, parameters and numbers replaced by a star."""
    keys: dict[str, set[str]] = {}
    for path in sorted(recorder.to.rglob("*.json")):
        case = json.loads(path.read_text(encoding="utf-8"))
        if "document" in case:
            parent = path.parent.name
            name = f"{parent}/{path.stem}" if parent == "commands" else parent
            keys.setdefault(name, set()).update(keys_in(case["document"], ""))
    recorder.write("keys.json", {name: sorted(places) for name, places in keys.items()})


def keys_in(value: Any, place: str) -> Iterator[str]:
    if isinstance(value, dict):
        for key, entry in value.items():
            here = f"{place}.{'*' if re.search(r'[0-9.]|_mm$|_deg$', key) else key}".lstrip(".")
            yield here
            yield from keys_in(entry, here)
    elif isinstance(value, list):
        for entry in value:
            yield from keys_in(entry, f"{place}[]")


def record(recorder: Recorder, only: str, opens: Path | None) -> None:
    """Record all parts whose name begins with `only`, two at a time; long ones first."""
    tasks: list[tuple[str, Callable[..., None], tuple[Any, ...]]] = [
        ("dry-runs", record_dry_run, (robot, scenario))
        for scenario in SCENARIOS
        for robot in ROBOTS
    ]
    tasks += [("commands", record_commands, ()), ("help", record_helps, ())]
    tasks += [("plans", record_plans, (robot,)) for robot in ROBOTS]
    tasks += [("identify", record_identifications, (robot,)) for robot in ROBOTS]
    tasks += [("faults", record_fault, (fault,)) for fault in FAULTS]
    with ThreadPoolExecutor(2) as pool:
        started = [
            pool.submit(work, recorder, *arguments)
            for part, work, arguments in tasks
            if part.startswith(only)
        ]
        for task in started:
            task.result()
    if "old".startswith(only):
        record_old(recorder, opens or recorder.to / "campaign")
    record_keys(recorder)


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", nargs="?", type=Path, help="folder to write")
    parser.add_argument("--compare", nargs=2, type=Path, metavar=("OLD", "NEW"))
    parser.add_argument("--most", type=int, default=20, help="lines shown for each file")
    parser.add_argument("--only", default="", help="only parts that begin so")
    parser.add_argument("--opens", type=Path, help="campaign folder of an older version")
    program = Path(sys.executable).with_name("pkmcal")
    parser.add_argument("--pkmcal", type=Path, default=program, help="program to measure")
    asked = parser.parse_args()
    if asked.compare:
        return compare(asked.compare[0], asked.compare[1], asked.most)
    if asked.folder is None:
        parser.error("name a FOLDER to write, or two records to --compare")
    asked.folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory() as work:
        record(Recorder(asked.pkmcal.absolute(), Path(work), asked.folder), asked.only, asked.opens)
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
