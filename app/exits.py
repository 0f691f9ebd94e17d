"""Errors of the command line, and the exit codes."""

from enum import IntEnum

from campaigns import errors as campaign
from drivers import errors as driver
from drivers.errors import ExplainedError
from sim.errors import SimError


class AppError(ExplainedError):
    """Root of everything that the command line itself raises."""


class NotConfirmed(AppError):
    """The operator has not consented: the command needs a yes on a terminal, or --yes."""


class AnswerLost(AppError):
    """The answer could not be written to standard output."""


class Exit(IntEnum):
    """The codes that scripts may rely on."""

    DONE = 0
    NOT_GOOD = 1
    BAD_INPUT = 2
    DEVICE = 3
    JOURNAL = 4
    BUG = 70
    INTERRUPTED = 130


def exit_code(error: Exception) -> Exit:
    """Return the code of a designed error; its most specific class in the table decides."""
    table: dict[type[Exception], Exit] = {
        AppError: Exit.BAD_INPUT,
        AnswerLost: Exit.JOURNAL,
        campaign.CampaignError: Exit.BAD_INPUT,
        campaign.JournalFailed: Exit.JOURNAL,
        campaign.WriteFailed: Exit.JOURNAL,
        campaign.JogRequired: Exit.DEVICE,
        campaign.NotSettled: Exit.DEVICE,
        campaign.TargetOutOfReach: Exit.DEVICE,
        campaign.GateRefused: Exit.DEVICE,
        campaign.LoadNotVerified: Exit.DEVICE,
        campaign.IdentificationRefused: Exit.NOT_GOOD,
        campaign.VerdictBad: Exit.NOT_GOOD,
        campaign.Interrupted: Exit.INTERRUPTED,
        driver.DriverError: Exit.DEVICE,
        driver.AddressInvalid: Exit.BAD_INPUT,
        driver.Cancelled: Exit.INTERRUPTED,
        SimError: Exit.BAD_INPUT,
    }
    for kind in type(error).__mro__:  # from the error's own class to its roots
        if kind in table:
            return table[kind]
    raise LookupError(f"{type(error).__name__} is no designed error")
