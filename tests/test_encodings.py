"""Every text that is read or written names its encoding: Windows has several."""

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
FILES = [
    ROOT / "pkmcal.py",
    *(
        file
        for room in ("app", "campaigns", "drivers", "sim", "benchmarks", "docs")
        for file in sorted((ROOT / room).rglob("*.py"))
    ),
]
NO_FILES = {"os", "self._session", "session"}
"""What else has a function `open`."""


def without_encoding(text):
    """Return the lines of calls that read or write text in the system's encoding."""
    return [
        node.lineno
        for node in ast.walk(ast.parse(text))
        if isinstance(node, ast.Call) and _is_in_any_encoding(node)
    ]


def _is_in_any_encoding(call):
    named = {word.arg: word.value for word in call.keywords}
    if "encoding" in named:
        return False
    if isinstance(call.func, ast.Attribute):
        name, owner = call.func.attr, ast.unparse(call.func.value)
        modes = call.args[:1]
    else:
        name, owner, modes = getattr(call.func, "id", ""), "", call.args[1:2]
    modes = [*modes, *(named[key] for key in named if key == "mode")]
    is_binary = any("b" in ast.literal_eval(mode) for mode in modes if _is_text(mode))
    return (
        _is_true(named.get("text"))
        or (name == "read_text" and owner != "" and not call.args)
        or (name == "write_text" and owner != "" and len(call.args) < 2)
        or (name in {"TextIOWrapper", "NamedTemporaryFile", "fdopen"} and not is_binary)
        or (name == "open" and owner not in NO_FILES and not is_binary and _is_of_file(call, owner))
    )


def _is_of_file(call, owner):
    """Whether a call of `open` can be a file's: by no argument, or by a mode in words."""
    return owner == "" or not call.args or _is_text(call.args[0])


def _is_true(node):
    return isinstance(node, ast.Constant) and node.value is True


def _is_text(node):
    return isinstance(node, ast.Constant) and isinstance(node.value, str)


def test_every_text_names_its_encoding():
    places = [
        f"{file.relative_to(ROOT)}:{line}"
        for file in FILES
        for line in without_encoding(file.read_text(encoding="utf-8"))
    ]
    assert places == []


def test_texts_without_one_are_seen():
    text = """open(path)
open(path, "rb")
path.open()
path.open("w", newline="")
path.open("ab")
path.read_text()
path.read_text("utf-8")
path.write_text(words)
path.write_text(words, encoding="utf-8")
subprocess.run(words, text=True)
TextIOWrapper(raw)
SerialTransport.open(place, number)
"""
    assert without_encoding(text) == [1, 3, 4, 6, 8, 10, 11]
