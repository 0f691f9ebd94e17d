"""The files that the page of the architecture names are there, and the lines that it quotes."""

import re

from pages import ROOT, blocks_of

PAGE = ROOT / "docs/explanation/architecture.md"
NAMED = re.compile(r"`((?:app|campaigns|drivers|sim)/[\w/.*]+)`")


def test_every_file_that_is_named_is_there():
    named = set(NAMED.findall(PAGE.read_text(encoding="utf-8")))
    assert len(named) > 50
    assert [name for name in sorted(named) if not any(ROOT.glob(name.rstrip("/")))] == []


def test_every_line_of_a_journey_is_in_the_file_that_it_names():
    for block in (block for block in blocks_of(PAGE) if block.language == "python"):
        name, *lines = block.text.splitlines()
        source = (ROOT / name.removeprefix("# ")).read_text(encoding="utf-8")
        assert [line for line in lines if line.strip() not in source] == [], name
