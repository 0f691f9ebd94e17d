"""The files that the pages for developers name are there, and the lines that they quote."""

import re
from importlib.util import find_spec

import pytest
from pages import ROOT, blocks_of

PAGE, CONTRIBUTING = ROOT / "docs/explanation/architecture.md", ROOT / "CONTRIBUTING.md"
NAMED = re.compile(r"`((?:[\w.*-]+/)+[\w.*-]*|[\w.-]+\.(?:py|toml|md))`")
CLASS = re.compile(r"`([A-Z][a-z]+(?:[A-Z][a-z]+)*)`")


@pytest.mark.parametrize(("page", "fewest"), [(PAGE, 50), (CONTRIBUTING, 20)])
def test_every_file_that_is_named_is_there(page, fewest):
    # NAME stands for the name of a contributor's own protocol
    named = {name.replace("NAME", "*") for name in NAMED.findall(page.read_text(encoding="utf-8"))}
    assert len(named) > fewest
    assert [name for name in sorted(named) if not any(ROOT.glob(name.rstrip("/")))] == []


def test_every_class_that_contributors_are_referred_to_is_there():
    named = set(CLASS.findall(CONTRIBUTING.read_text(encoding="utf-8")))
    folders = ("app", "campaigns", "drivers", "sim", "tests")
    files = (file for folder in folders for file in (ROOT / folder).rglob("*.py"))
    source = "\n".join(file.read_text(encoding="utf-8") for file in files)
    assert len(named) > 5
    assert [name for name in sorted(named) if f"class {name}" not in source] == []


def test_every_command_that_contributors_are_referred_to_is_there():
    text = CONTRIBUTING.read_text(encoding="utf-8")
    targets = set(re.findall(r"(?:`|^)make ([a-z-]+)", text, re.MULTILINE))
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert len(targets) > 8
    assert targets <= set(re.findall(r"^([a-z-]+):", makefile, re.MULTILINE))
    modules = set(re.findall(r"(?:python -m |`)(benchmarks(?:\.\w+)+)", text))
    assert len(modules) > 8
    assert [name for name in sorted(modules) if find_spec(name) is None] == []


def test_every_line_of_a_journey_is_in_the_file_that_it_names():
    for block in (block for block in blocks_of(PAGE) if block.language == "python"):
        name, *lines = block.text.splitlines()
        source = (ROOT / name.removeprefix("# ")).read_text(encoding="utf-8")
        assert [line for line in lines if line.strip() not in source] == [], name
