"""Devices at the far end of a pipe, as most tests of a driver find them."""

import pytest
import scripted_controller
import scripted_linuxcnc


@pytest.fixture
def controller():
    """A robotline controller, connected."""
    return scripted_controller.connected()


@pytest.fixture
def linuxcnc():
    """A LinuxCNC that takes joints, connected and ready to move."""
    return scripted_linuxcnc.ready()
