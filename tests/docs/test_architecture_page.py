"""The files that the page of the architecture names are there."""

import re

from pages import ROOT

PAGE = ROOT / "docs/explanation/architecture.md"
NAMED = re.compile(r"`((?:app|campaigns|drivers|sim)/[\w/.*]+)`")


def test_every_file_that_is_named_is_there():
    named = set(NAMED.findall(PAGE.read_text(encoding="utf-8")))
    assert len(named) > 50
    assert [name for name in sorted(named) if not any(ROOT.glob(name.rstrip("/")))] == []
