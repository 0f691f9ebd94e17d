"""Find what our rules of style forbid in the product's code.

python -m benchmarks.style [--lower | --draw SEED]

The rules stand in CONTRIBUTING.md, ceilings of their breaches in pyproject.toml; `--lower` brings
each down to a tenth above what there is, 0 to 0. That docstrings begin with a verb is ruff's D401.
`--draw` prints fifty functions for a reader to judge.
"""

import ast
import io
import random
import re
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.size import PRODUCT, ROOT, files_of, lower

MOST_PARAMETERS = 6
FEWEST_UNLIKE = 3
MIRRORS = frozenset({"command", "identify", "plan", "study"})
"""Commands, and functions of the Python API with the options of one."""

INSTEAD = {
    r"\bt(?:old|ells?|elling)\b": "data do not speak: determine, identify, report, distinguish",
    r"\bheed(?:s|ed)?\b": "apply, respect, react to",
    r"\bthat (?:is|are) none\b": "state the condition: 'if a size is not positive'",
    r"\bthe same(?=[.,;:)]|$)": "name what is the same: 'the same series'",
    r"\b(?:anew|likewise|whoever|nobody)\b": "again, also, the person who, no one",
    r"\bas (?!(?:soon|long|far|well|many|much) as\b)(?:\w+ ){1,2}as\b": "split the comparison",
}
"""Forbidden in docstrings and comments, and what to write."""

IN_MESSAGES = {
    r"\bpackets passed over\b": "ignored packets",
    r"\b(?:not )?settled? after \d+ rounds\b|\bfit (?:did not settle|settled)\b": "converged",
    r"\bno shot determines\b": "not observable",
    r"\bdoes not have all parameters\b": "does not accept all parameters",
    r"\bjournal is whole\b": "the journal is intact",
    r"\blook on by\b": "follow with",
    r"\byields? to the plate's weight\b": "drive compliance",
    r"\bout of their direction\b": "misalignment",
    r"\b(?:the )?operator goes on\b": "resumed by the operator",
    r"\bnot confirmed: ": "state the opposite: 'plan.csv is not the plan that was measured'",
    r"\bas none finds\b|\basked for kept\b": "say it as the field does",
}
"""Forbidden in messages, the texts of code and of tests, and what the field says."""

BANNED = frozenset({"found", "each", "own", "known", "left", "told", "rest", "some", "one"})
"""Names that say nothing of what they hold; free in comprehensions of one line."""


@dataclass(frozen=True, slots=True)
class Breach:
    """A place that breaks a rule, the words there, and what to write instead."""

    rule: str
    place: str
    words: str
    instead: str

    def __str__(self) -> str:
        return f"{self.place}: {self.words} → {self.instead}"


def breaches() -> list[Breach]:
    """Find every breach in the product's files, and foreign messages that tests expect."""
    product = [breach for file in sorted(files_of(*PRODUCT)) for breach in breaches_in(file)]
    in_tests = (breach for file in sorted(files_of("tests")) for breach in breaches_in(file))
    return [*product, *(breach for breach in in_tests if breach.rule == "messages")]


def breaches_in(file: Path) -> Iterator[Breach]:
    text = file.read_text(encoding="utf-8")
    name = file.relative_to(ROOT) if file.is_relative_to(ROOT) else file.name
    module = ast.parse(text)
    findings = (
        *stop_words(module, text),
        *messages(module),
        *banned_names(module),
        *signatures(module),
        *callable_tuples(module),
    )
    for rule, line, words, instead in findings:
        yield Breach(rule, f"{name}:{line}", words, instead)


def prose_of(module: ast.Module, text: str) -> Iterator[tuple[int, str]]:
    """Yield docstrings, also of fields, and comments with the line that each begins in."""
    for node in ast.walk(module):
        match node:
            case ast.Expr(value=ast.Constant(value=str(words))):
                yield node.lineno, words
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT:
            yield token.start[0], token.string


def stop_words(module: ast.Module, text: str) -> Iterator[tuple[str, int, str, str]]:
    for begin, prose in prose_of(module, text):
        words = re.sub("`[^`\n]*`", lambda code: "`" * len(code[0]), prose)  # code is no prose
        for pattern, instead in INSTEAD.items():
            for hit in re.finditer(pattern, words, re.IGNORECASE | re.MULTILINE):
                line = begin + words.count("\n", 0, hit.start())
                yield "stop_words", line, f"'{hit[0]}'", instead


def messages(module: ast.Module) -> Iterator[tuple[str, int, str, str]]:
    """Yield foreign turns of phrase in texts, docstrings left to `stop_words`."""
    prose = {
        id(node.value)
        for node in ast.walk(module)
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    }
    for node in ast.walk(module):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and id(node) not in prose:
            for pattern, instead in IN_MESSAGES.items():
                for hit in re.finditer(pattern, node.value):
                    yield "messages", node.lineno, f"'{hit[0]}'", instead


def banned_names(module: ast.Module) -> Iterator[tuple[str, int, str, str]]:
    """Yield names that could hold anything, of variables, fields, parameters and functions."""
    short = {
        id(name)
        for node in ast.walk(module)
        if isinstance(node, ast.ListComp | ast.SetComp | ast.DictComp | ast.GeneratorExp)
        and node.lineno == node.end_lineno
        for name in ast.walk(node)
    }
    for node in ast.walk(module):
        match node:
            case (
                ast.Name(id=name, ctx=ast.Store(), lineno=line)
                | ast.arg(arg=name, lineno=line)
                | ast.FunctionDef(name=name, lineno=line)
            ) if name in BANNED and id(node) not in short:
                yield "banned_names", line, f"the name {name}", "say what it holds"


def signatures(module: ast.Module) -> Iterator[tuple[str, int, str, str]]:
    """Yield functions with too many parameters, or that return a bare tuple of unlike values."""
    for node in ast.walk(module):
        if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        given = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
        count = len([arg for arg in given if arg.arg not in ("self", "cls")])
        if count > MOST_PARAMETERS and node.name not in MIRRORS:
            words = f"{node.name} has {count} parameters"
            yield "wide_functions", node.lineno, words, f"at most {MOST_PARAMETERS}: group them"
        match node.returns:
            case ast.Subscript(value=ast.Name(id="tuple"), slice=ast.Tuple(elts=kinds)):
                unlike = {ast.unparse(kind) for kind in kinds} - {"..."}
                if len(kinds) >= FEWEST_UNLIKE and len(unlike) > 1:
                    words = f"{node.name} returns {ast.unparse(node.returns)}"
                    yield "bare_tuples", node.lineno, words, "give the values a dataclass"


def callable_tuples(module: ast.Module) -> Iterator[tuple[str, int, str, str]]:
    """Yield types of tuples that hold a function."""
    for node in ast.walk(module):
        match node:
            case ast.Subscript(value=ast.Name(id="tuple"), slice=ast.Tuple(elts=kinds)) if any(
                ast.unparse(kind).startswith("Callable[") for kind in kinds
            ):
                yield "callable_tuples", node.lineno, ast.unparse(node), "name its parts in a class"


RULES = (
    "stop_words",
    "messages",
    "banned_names",
    "wide_functions",
    "bare_tuples",
    "callable_tuples",
)


def counts() -> dict[str, int]:
    """Count the breaches of each rule."""
    rules = [breach.rule for breach in breaches()]
    return {rule: rules.count(rule) for rule in RULES}


def comments_by_room() -> dict[str, tuple[int, int]]:
    """Count comments, without marks for tools, and lines of each folder, and of all."""
    comments, lines = Counter[str](), Counter[str]()
    for file in files_of(*PRODUCT):
        text = file.read_text(encoding="utf-8")
        tokens = tokenize.generate_tokens(io.StringIO(text).readline)
        prose = [token for token in tokens if token.type == tokenize.COMMENT]
        count = sum(not re.match(r"# (noqa|type:|fmt:|pragma)", token.string) for token in prose)
        for room in (str(file.parent.relative_to(ROOT)), "all"):
            comments[room] += count
            lines[room] += len(text.splitlines())
    return {room: (comments[room], lines[room]) for room in sorted(lines)}


def draw_functions(seed: int, count: int = 50) -> Iterator[str]:
    """Draw functions that have a docstring, each with its place and source."""
    functions = []
    for file in sorted(files_of(*PRODUCT)):
        text = file.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)):
            if isinstance(node, ast.FunctionDef) and ast.get_docstring(node):
                source = ast.get_source_segment(text, node)
                functions.append(f"{file.relative_to(ROOT)}:{node.lineno}\n{source}\n")
    yield from random.Random(seed).sample(functions, count)


if __name__ == "__main__":
    match sys.argv[1:]:
        case ["--lower"]:
            lower(counts(), "style")
        case ["--draw", seed]:
            print(*draw_functions(int(seed)), sep="\n")
            sys.exit()
    for breach in breaches():
        print(breach)
    print(counts())
    print("comments per 1 000 lines:")
    for room, (comments, lines) in comments_by_room().items():
        print(f"{room:30}{1000 * comments / lines:6.1f}")
