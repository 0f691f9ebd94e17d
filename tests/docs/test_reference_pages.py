"""The reference pages that are written from the code are up to date."""

import runpy

import pytest
from pages import ROOT


@pytest.mark.slow
def test_reference_pages_are_up_to_date():
    pages = runpy.run_path(str(ROOT / "docs/make_reference.py"))["pages"]()
    assert len(pages) == 2
    for page, text in pages.items():
        assert page.read_text(encoding="utf-8") == text, "run: python docs/make_reference.py"
