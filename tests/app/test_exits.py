"""Every designed error has its exit code."""

import pytest

from app import exits as door_errors
from app.exits import Exit, exit_code
from campaigns import errors as campaign_errors
from drivers import errors as driver_errors
from drivers.errors import ExplainedError
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


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (door_errors.NotConfirmed, 2),
        (campaign_errors.OptionsInvalid, 2),
        (campaign_errors.ConfigInvalid, 2),
        (campaign_errors.PlanInvalid, 2),
        (campaign_errors.OutputExists, 2),
        (campaign_errors.CampaignLocked, 2),
        (sim_errors.ScenarioInvalid, 2),
        (driver_errors.AddressInvalid, 2),
        (campaign_errors.VerdictBad, 1),
        (campaign_errors.NotSettled, 3),
        (campaign_errors.JogRequired, 3),
        (driver_errors.LinkDown, 3),
        (driver_errors.EmergencyStop, 3),
        (driver_errors.RobotStateUnknown, 3),
        (campaign_errors.JournalFailed, 4),
        (campaign_errors.WriteFailed, 4),
        (campaign_errors.Interrupted, 130),
        (driver_errors.Cancelled, 130),
    ],
)
def test_what_scripts_may_rely_on(error, code):
    assert exit_code(error("a problem", remedy="a remedy")) == code


def test_an_error_of_a_new_package_is_noticed():
    with pytest.raises(LookupError, match="ExplainedError"):
        exit_code(ExplainedError("a problem", remedy="a remedy"))
