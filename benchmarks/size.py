"""Print how large the house is, beside the ceilings in pyproject.toml.

python -m benchmarks.size [--lower]

Lines are all lines of .py files. A constant is a name at the top of a module that stands for a
number, or for arithmetic or tuples of numbers. `--lower` brings each ceiling down to a tenth above
what there is: a small change passes, growth does not.
"""

import ast
import re
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]
CEILINGS = ROOT / "pyproject.toml"
PRODUCT = ("app", "campaigns", "drivers", "sim")


def files_of(*folders: str) -> list[Path]:
    return [file for folder in folders for file in (ROOT / folder).rglob("*.py")]


def lines_of(*folders: str) -> int:
    texts = (file.read_text(encoding="utf-8") for file in files_of(*folders))
    return sum(len(text.splitlines()) for text in texts)


def is_dataclass(node: ast.ClassDef) -> bool:
    calls = (mark.func if isinstance(mark, ast.Call) else mark for mark in node.decorator_list)
    return any(ast.unparse(mark).rpartition(".")[2] == "dataclass" for mark in calls)


def is_numeric(value: ast.expr | None) -> bool:
    match value:
        case ast.Constant(value=number):
            return isinstance(number, int | float) and not isinstance(number, bool)
        case ast.UnaryOp(operand=operand):
            return is_numeric(operand)
        case ast.BinOp(left=left, right=right):
            return is_numeric(left) and is_numeric(right)
        case ast.Tuple(elts=entries):
            return bool(entries) and all(map(is_numeric, entries))
    return False


def constants_in(module: ast.Module) -> Iterator[str]:
    """Yield the names at a module's top that stand for numbers."""
    for node in module.body:
        if isinstance(node, ast.Assign | ast.AnnAssign) and is_numeric(node.value):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            names = (name for target in targets for name in ast.walk(target))
            yield from (name.id for name in names if isinstance(name, ast.Name))


def sizes() -> dict[str, int]:
    """Count what the ceilings hold, by their names."""
    modules = [ast.parse(file.read_bytes()) for file in files_of(*PRODUCT)]
    nodes = (node for module in modules for node in ast.walk(module))
    classes = [node for node in nodes if isinstance(node, ast.ClassDef)]
    return {
        "product_lines": lines_of(*PRODUCT),
        "product_files": len(modules),
        "classes": len(classes),
        "dataclasses": sum(map(is_dataclass, classes)),
        "constants": sum(len([*constants_in(module)]) for module in modules),
        "test_lines": lines_of("tests"),
        "benchmark_lines": lines_of("benchmarks"),
    }


def ceilings(table: str = "size") -> dict[str, int]:
    settings = tomllib.loads(CEILINGS.read_text(encoding="utf-8"))
    return dict(settings["tool"]["pkmcal"][table])


def ceiling_of(size: int) -> int:
    """Return a ceiling with a slack of 10 %; what is not there at all gets none."""
    return size + size // 10


def lowered(text: str, measured: dict[str, int], table: str = "size") -> str:
    """Bring down each ceiling in pyproject.toml's text that has more slack than it needs."""
    for name, size in measured.items():
        lower = min(ceilings(table)[name], ceiling_of(size))
        text = re.sub(rf"(?m)^{name} = \d+", f"{name} = {lower}", text)
    return text


def lower(measured: dict[str, int], table: str = "size") -> None:
    """Lower the ceilings in pyproject.toml."""
    text = CEILINGS.read_text(encoding="utf-8")
    CEILINGS.write_text(lowered(text, measured, table), encoding="utf-8")


if __name__ == "__main__":
    measured = sizes()
    if sys.argv[1:] == ["--lower"]:
        lower(measured)
    for name, size in measured.items():
        print(f"{name:16}{size:8}  of {ceilings()[name]}")
