"""Which series count as simulated: those whose devices were, and no other."""

import pytest

from campaigns.evaluation.simulated_devices import MODELS, VENDOR, simulated_devices
from campaigns.journal.records import SeriesStarted, Stage
from campaigns.journal.views import Series
from drivers.values import Identity
from sim.robot.controller import SimulatedController
from sim.tracker.instrument import SimulatedTracker

REAL = Identity("Acme", "Par4", "R-1", "1.0", "robotline 1")
REAL_TRACKER = Identity("Leica", "AT403", "T-7", "2.3", "emScon")
SERVED = Identity(VENDOR, "simulated Par4 controller", "SIM-C-0001", "1.0", "robotline 1")
SERVED_TRACKER = Identity("Leica", "SIM-LT", "390001", "1.0", "emScon")
ADDRESSES = {"controller": {"url": "tcp://h:1"}, "tracker": {"url": "tcp://h:2"}}
EMBEDDED = {"controller": {"url": "sim://cell"}, "tracker": {"url": "sim://cell"}}


def series(
    number: int,
    robot: Identity | None = REAL,
    tracker: Identity | None = REAL_TRACKER,
    settings: object = ADDRESSES,
    stage: Stage = "run",
) -> Series:
    started = SeriesStarted(stage, "p", settings, "0", "r", robot, tracker, None)
    return Series(number, "2026-03-02T08:00:00.000+00:00", started, finished=True)


def says(*every: Series, planned: bool = False) -> str:
    return simulated_devices(every, planned=planned)


def test_neither_real_devices_nor_an_import_are_called_simulated() -> None:
    assert says(series(1), series(2)) == ""
    assert says(series(1, settings={})) == ""
    imported = series(1, None, None, EMBEDDED, "import")
    assert says(imported, planned=True) == ""


@pytest.mark.parametrize(
    "measured",
    [
        series(1, settings=EMBEDDED),
        series(1, SERVED, SERVED_TRACKER),
        series(1, SERVED, SERVED_TRACKER, {}),
    ],
    ids=["by its address", "by its identity", "older journal"],
)
def test_a_cell_is_known_by_its_address_or_by_what_it_says(measured: Series) -> None:
    assert says(measured) == "Simulated cell: no real robot was measured."


def test_the_simulated_devices_say_the_words_by_which_they_are_known() -> None:
    assert SimulatedController.vendor == VENDOR
    assert SimulatedTracker.name in MODELS


def test_only_what_was_simulated_is_named() -> None:
    assert says(series(1, tracker=SERVED_TRACKER), series(2)) == (
        "Simulated: the tracker of series 1."
    )
    imported = series(1, None, None, EMBEDDED, "import")
    assert says(imported, series(2, settings=EMBEDDED), planned=True) == (
        "Simulated: the controller of series 2; the tracker of series 2."
    )


def test_before_anything_was_measured_the_settings_say_it() -> None:
    assert says(planned=True) == "Simulated cell: no real robot was measured."
    assert says(planned=False) == ""
    assert says(series(1), planned=True) == "", "measured on real devices, whatever is set now"
