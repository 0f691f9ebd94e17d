"""Every designed error has its exit code."""

import pytest

from app import exits as door_errors
from app.exits import Exit, exit_code
from campaigns import errors as campaign_errors
from drivers import errors as driver_errors
from sim import errors as sim_errors

ROOTS = (
    door_errors.AppError,
    campaign_errors.CampaignError,
    driver_errors.DriverError,
    sim_errors.SimError,
)


def all_below(root):
    for kind in root.__subclasses__():
        yield kind
        yield from all_below(kind)


@pytest.mark.parametrize("root", ROOTS)
def test_every_error_has_a_code(root):
    for kind in (root, *all_below(root)):
        assert exit_code(kind.__new__(kind)) in set(Exit) - {Exit.DONE, Exit.BUG}


RELIED_ON = {
    1: "VerdictBad",
    2: "NotConfirmed OptionsInvalid ConfigInvalid PlanInvalid OutputExists "
    "CampaignLocked ScenarioInvalid AddressInvalid",
    3: "NotSettled JogRequired LinkDown EmergencyStop RobotStateUnknown",
    4: "JournalFailed WriteFailed",
    130: "Interrupted Cancelled",
}


@pytest.mark.parametrize("code", RELIED_ON)
def test_what_scripts_may_rely_on(code):
    kinds = {kind.__name__: kind for root in ROOTS for kind in all_below(root)}
    for name in RELIED_ON[code].split():
        assert exit_code(kinds[name]("a problem", remedy="a remedy")) == code, name
