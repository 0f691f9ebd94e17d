"""Which series count as simulated: those whose devices were, and no other."""

import pytest

from campaigns.evaluation.simulated_devices import MODELS, NO_REAL_ROBOT, VENDOR, simulated_devices
from campaigns.journal.records import SeriesStarted
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


def series(number, robot=REAL, tracker=REAL_TRACKER, settings=ADDRESSES, stage="run"):
    started = SeriesStarted(stage, "p", settings, "0", "r", robot, tracker, None)
    return Series(number, "2026-03-02T08:00:00.000+00:00", started, finished=True)


IMPORTED = series(1, None, None, EMBEDDED, "import")


@pytest.mark.parametrize(
    ("measured", "planned", "said"),
    [
        ([series(1), series(2)], False, ""),
        ([series(1, settings={})], False, ""),
        ([series(1)], True, ""),  # measured on real devices, whatever is set now
        ([IMPORTED], True, ""),
        ([], False, ""),
        ([], True, NO_REAL_ROBOT),
        ([series(1, settings=EMBEDDED)], False, NO_REAL_ROBOT),
        ([series(1, SERVED, SERVED_TRACKER)], False, NO_REAL_ROBOT),
        ([series(1, SERVED, SERVED_TRACKER, {})], False, NO_REAL_ROBOT),  # an older journal
        (
            [series(1, tracker=SERVED_TRACKER), series(2)],
            False,
            "Simulated: the tracker of series 1.",
        ),
        (
            [IMPORTED, series(2, settings=EMBEDDED)],
            True,
            "Simulated: the controller of series 2; the tracker of series 2.",
        ),
    ],
)
def test_devices_are_called_simulated_by_address_or_identity_alone(measured, planned, said):
    assert simulated_devices(measured, planned=planned) == said


def test_the_simulated_devices_state_the_words_by_which_they_are_recognised():
    assert SimulatedController.vendor == VENDOR
    assert SimulatedTracker.name in MODELS
