"""One whole campaign for all tests that only read it, and pages without their figures."""

import pytest


@pytest.fixture(autouse=True)
def undrawn(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> None:
    """Leaves out figures, which take seconds, but for whole pages and a browser."""
    if not {"whole_html", "browser"} & {*request.fixturenames}:
        monkeypatch.setattr("app.report.rendering.drawn", lambda *_, **_named: "")
