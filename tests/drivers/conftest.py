"""Devices at the far end of a pipe, as most tests of a driver find them."""

import pytest
import scripted_controller


@pytest.fixture
def controller():
    """A robotline controller, connected."""
    return scripted_controller.connected()
