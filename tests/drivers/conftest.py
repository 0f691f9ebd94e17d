"""What tests of several drivers share."""

import pytest


@pytest.fixture
def no_pause_at_start(monkeypatch):
    """geocompy sleeps for a second whenever it is connected."""
    monkeypatch.setattr("geocompy.geo.sleep", lambda seconds: None)
