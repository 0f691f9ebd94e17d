"""How large the house is: lines, classes, contracts, and whether modules import in a circle.

python -m benchmarks.size [--product 44000] [--classes 620] [--dataclasses 370] [--tests 37000]
    [--benchmarks 3000] [--contracts 11] [--json]

The options are the limits. Lines are all lines of .py files; a dataclass is a class with a
decorator of that name. Imports for type checkers alone make no circle; those within functions do.
"""

import ast
import tomllib
from collections.abc import Iterator
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import grimp

from benchmarks.shared.yardstick import Figure, Report, Table, main

ROOT = Path(__file__).parents[1]
PRODUCT = ("app", "campaigns", "drivers", "sim")


def files_of(folder: str) -> Iterator[Path]:
    return (ROOT / folder).rglob("*.py")


def lines_in(*folders: str) -> int:
    texts = (file.read_text(encoding="utf-8") for name in folders for file in files_of(name))
    return sum(len(text.splitlines()) for text in texts)


def classes_in(*folders: str) -> list[ast.ClassDef]:
    """All of them, those within functions and other classes too."""
    trees = (ast.parse(file.read_bytes()) for name in folders for file in files_of(name))
    return [node for tree in trees for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]


def is_dataclass(found: ast.ClassDef) -> bool:
    marks = (each.func if isinstance(each, ast.Call) else each for each in found.decorator_list)
    return any("dataclass" in (getattr(m, "id", ""), getattr(m, "attr", "")) for m in marks)


def import_contracts() -> int:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    return len(settings["tool"]["importlinter"]["contracts"])


def circle_of_imports() -> list[str]:
    """Modules that import each other in a circle, the first once more at the end; else none."""
    graph = grimp.build_graph(*PRODUCT, exclude_type_checking_imports=True, cache_dir=None)
    imports = {name: graph.find_modules_directly_imported_by(name) for name in graph.modules}
    try:
        TopologicalSorter(imports).prepare()
    except CycleError as error:
        return list(reversed(error.args[1]))
    return []


def measure(
    product: int, classes: int, dataclasses: int, tests: int, benchmarks: int, contracts: int
) -> Report:
    found = [classes_in(name) for name in PRODUCT]
    data = [sum(map(is_dataclass, own)) for own in found]
    rows = list(zip(PRODUCT, map(lines_in, PRODUCT), map(len, found), data, strict=True))
    circle = circle_of_imports()
    tables = [Table("Product", ("", "lines", "classes", "dataclasses"), rows)]
    if circle:
        tables.append(Table("Modules in a circle", ("",), [(name,) for name in circle]))
    figures = [
        Figure("product", lines_in(*PRODUCT), "lines", highest=product),
        Figure("classes", sum(map(len, found)), highest=classes),
        Figure("dataclasses", sum(data), highest=dataclasses),
        Figure("tests", lines_in("tests"), "lines", highest=tests),
        Figure("benchmarks", lines_in("benchmarks"), "lines", highest=benchmarks),
        Figure("import contracts", import_contracts(), highest=contracts),
        Figure("circles of imports", int(bool(circle)), highest=0),
    ]
    return Report(figures, tables)


if __name__ == "__main__":
    limits = {"product": 44000, "classes": 620, "dataclasses": 370, "tests": 37000}
    raise SystemExit(main(__doc__, measure, **limits, benchmarks=3000, contracts=11))
