"""Count how often the tests notice that one place of the code was changed.

python -m benchmarks.mutants [--sample 200] [--seed 2026] [--jobs 2] [--folder FOLDER]

Needs `pip install pytest-cov`. A run of the suite says which tests execute each line and how long
they take; `--folder` keeps it for another time. Drawn mutants are then written, one at a time, into
a copy of the checkout. Each meets tests that execute its line, those of its own room first, and is
killed if one of them fails or does not end.
"""

import argparse
import ast
import random
import re
import shutil
import sqlite3
import subprocess
import sys
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from queue import Queue
from typing import Any

from benchmarks.size import ROOT

MODULES = (
    "drivers/link.py",
    "drivers/stopping.py",
    "campaigns/measuring/gate.py",
    "campaigns/controllers/load.py",
    "campaigns/controllers/load_checks.py",
    "campaigns/journal/database.py",
    "campaigns/journal/journal.py",
    "campaigns/fit/fit.py",
    "campaigns/fit/wrong_shots.py",
    "campaigns/fit/effects.py",
    "campaigns/fit/error_model.py",
    "campaigns/fit/events.py",
    "campaigns/fit/periods.py",
    "campaigns/fit/layers.py",
    "campaigns/fit/left_out.py",
    "campaigns/fit/uncertainty.py",
    "campaigns/fit/design.py",
    "campaigns/identification/hold_out.py",
    "campaigns/identification/observations.py",
    "campaigns/identification/checking.py",
    "campaigns/identification/positions.py",
    "campaigns/identification/repeats.py",
    "campaigns/evaluation/decision.py",
)
"""Modules that guard motion, data and figures."""
MOST_TESTS, MOST_SECONDS = 60, 15.0
"""Tests that a mutant meets, and their time in the first run."""

OPPOSITES: dict[type[ast.AST], type[ast.AST]] = {
    new: old
    for pair in (
        (ast.Lt, ast.LtE),
        (ast.Gt, ast.GtE),
        (ast.Eq, ast.NotEq),
        (ast.Is, ast.IsNot),
        (ast.In, ast.NotIn),
        (ast.Add, ast.Sub),
        (ast.Mult, ast.Div),
        (ast.And, ast.Or),
    )
    for new, old in (pair, pair[::-1])
} | {ast.MatMult: ast.Add, ast.Pow: ast.Mult}
PYTEST = (sys.executable, "-B", "-m", "pytest", "-q", "-p", "no:cacheprovider")


@dataclass(frozen=True, slots=True, order=True)
class Mutant:
    """Characters of a module, and the text that replaces them."""

    module: str
    line: int
    begin: int
    end: int
    text: str

    def applied_to(self, code: str) -> str:
        return code[: self.begin] + self.text + code[self.end :]

    def in_words(self, code: str) -> str:
        before = " ".join(code[self.begin : self.end].split())
        return f"{self.module}:{self.line}: {before} → {self.text}"


def code_of(module: str, root: Path = ROOT) -> str:
    return (root / module).read_text(encoding="utf-8")


def changed(node: ast.AST) -> str | None:
    """Return what a mutant has in place of an operator, `not`, number, truth, call or raise."""
    match node:
        case ast.Compare(left=left, ops=[operator], comparators=[_] as right):
            return f"({ast.unparse(ast.Compare(left, [opposite(operator)], right))})"
        case ast.BinOp(left=left, op=operator, right=right) if type(operator) in OPPOSITES:
            return f"({ast.unparse(ast.BinOp(left, opposite(operator), right))})"
        case ast.BoolOp(op=operator, values=values):
            return f"({ast.unparse(ast.BoolOp(opposite(operator), values))})"
        case ast.UnaryOp(op=ast.Not(), operand=operand):
            return ast.unparse(operand)
        case ast.Constant(value=bool(value)):
            return str(not value)
        case ast.Constant(value=int() | float() as value):
            return repr(value + 1)
        case ast.Expr(value=ast.Call()) | ast.Raise():
            return "pass"
    return None


def opposite(operator: ast.AST) -> Any:
    return OPPOSITES[type(operator)]()


def mutants_of(module: str, code: str) -> Iterator[Mutant]:
    """Yield the mutants of a module's functions."""
    rows = code.splitlines(keepends=True)

    def offset(line: int, column: int) -> int:
        """Return the place among all characters; ast counts columns in bytes."""
        return sum(map(len, rows[: line - 1])) + len(rows[line - 1].encode()[:column].decode())

    functions = (n for n in ast.walk(ast.parse(code)) if isinstance(n, ast.FunctionDef))
    statements = (statement for function in functions for statement in function.body)
    for node in (node for statement in statements for node in ast.walk(statement)):
        text = changed(node)
        if text is not None:
            place: Any = node  # an expression or statement has its place
            begin = offset(place.lineno, place.col_offset)
            end = offset(place.end_lineno, place.end_col_offset)
            yield Mutant(module, place.lineno, begin, end, text)


class Suite:
    """The tests that execute each line, with their seconds, from one run with coverage."""

    def __init__(self, folder: Path) -> None:
        self._data, self._log = folder / "coverage", folder / "durations"
        if not self._data.exists():
            self._run(folder / "coveragerc")
        self.seconds: dict[str, float] = defaultdict(float)
        took = r"([\d.]+)s (?:call|setup) +(tests/.+)"
        for seconds, test in re.findall(took, self._log.read_text(encoding="utf-8")):
            self.seconds[test.strip()] += float(seconds)
        self.tests: dict[tuple[str, int], set[str]] = defaultdict(set)
        with sqlite3.connect(self._data) as connection:
            rows = connection.execute(
                "select path, context, numbits from line_bits join file on file_id = file.id"
                " join context on context_id = context.id where context != ''"
            )
            for path, context, bits in rows:
                module, test = str(Path(path).relative_to(ROOT)), context.rpartition("|")[0]
                for line in range(8 * len(bits)):
                    if bits[line // 8] >> line % 8 & 1:
                        self.tests[module, line].add(test)

    def _run(self, settings: Path) -> None:
        settings.write_text(f"[run]\ndata_file = {self._data}\n", encoding="utf-8")
        folders = {f"--cov={Path(module).parent}" for module in MODULES}
        options = ("--numprocesses=2", "--timeout=600", "--durations=0", "-vv", "--cov-report=")
        marks = ("-m", "not peer and not long", "--cov-context=test", f"--cov-config={settings}")
        with self._log.open("w", encoding="utf-8") as log:
            subprocess.run((*PYTEST, *options, *marks, *folders), cwd=ROOT, stdout=log, check=False)

    def tests_for(self, mutant: Mutant) -> list[str]:
        """Return tests that execute a mutant's line: those of its room first, then by seconds."""
        room = f"tests/{Path(mutant.module).parent}/"
        tests = self.tests[mutant.module, mutant.line]
        order = sorted(tests, key=lambda t: (not t.startswith(room), self.seconds[t], t))
        chosen: list[str] = []
        spent_s = 0.0
        for test in order[:MOST_TESTS]:
            spent_s += self.seconds[test]
            if chosen and spent_s > MOST_SECONDS:
                break
            chosen.append(test)
        return chosen


def is_killed(mutant: Mutant, tests: list[str], checkout: Path) -> bool:
    """Write a mutant into a checkout, run tests until one fails, and mend the checkout."""
    code = code_of(mutant.module, checkout)
    file = checkout / mutant.module
    file.write_text(mutant.applied_to(code), encoding="utf-8")
    command = (*PYTEST, "-x", "-p", "no:xdist", "--timeout=60", *tests)
    try:
        return bool(
            subprocess.run(
                command, cwd=checkout, capture_output=True, timeout=300, check=False
            ).returncode
        )
    except subprocess.TimeoutExpired:
        return True
    finally:
        file.write_text(code, encoding="utf-8")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    for name, default in {"sample": 200, "seed": 2026, "jobs": 2}.items():
        parser.add_argument(f"--{name}", type=int, default=default)
    parser.add_argument("--folder", type=Path, default=None)
    asked = parser.parse_args()
    folder = asked.folder or Path(tempfile.mkdtemp())
    folder.mkdir(exist_ok=True)
    suite = Suite(folder)
    codes = {module: code_of(module) for module in MODULES}
    everything = sorted({m for name, code in codes.items() for m in mutants_of(name, code)})
    drawn = random.Random(asked.seed).sample(everything, asked.sample)
    checkouts: Queue[Path] = Queue()
    for job in range(asked.jobs):
        place = folder / f"checkout{job}"
        shutil.rmtree(place, ignore_errors=True)  # after an interruption it holds a mutant
        shutil.copytree(ROOT, place, ignore=shutil.ignore_patterns(".*", "demo", "__pycache__"))
        checkouts.put(place)

    def judge(mutant: Mutant) -> bool:
        checkout = checkouts.get()
        try:
            tests = suite.tests_for(mutant)
            killed = bool(tests) and is_killed(mutant, tests, checkout)
        finally:
            checkouts.put(checkout)
        verdict = "killed  " if killed else "survived"
        print(
            f"{verdict} {len(tests):3} tests  {mutant.in_words(codes[mutant.module])}", flush=True
        )
        return killed

    with ThreadPoolExecutor(asked.jobs) as pool:
        killed = [*pool.map(judge, drawn)]
    for module in MODULES:
        results = [k for mutant, k in zip(drawn, killed, strict=True) if mutant.module == module]
        print(f"{module:40}{sum(results):4} of {len(results)}")
    print(f"killed {sum(killed)} of {len(drawn)}, drawn from {len(everything)}")


if __name__ == "__main__":
    main()
