"""What can be wrong with what was asked for at the door."""

from drivers.errors import ExplainedError


class AppError(ExplainedError):
    """Root of everything that the command line itself raises."""


class UsageInvalid(AppError):
    """The options don't go together, or ask for what there is not: change the command."""


class NotConfirmed(AppError):
    """The operator's yes is missing: ask on a terminal, or give --yes."""
