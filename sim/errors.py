"""Errors of the simulated cell itself, named by what its user does next."""

from drivers.errors import ExplainedError


class SimError(ExplainedError):
    """Server that could not start or broke, memory of another cell, or a class below."""


class ScenarioInvalid(SimError):
    """A scenario cannot be read, or describes no cell that can be built."""

    page = "docs/reference/files.md#cellyaml"


class AssemblyLost(SimError):
    """The mechanism cannot be moved to its target.

    `part` is how much of the straight joint path, 0 to 1, it can follow.
    """

    def __init__(self, problem: str, *, remedy: str, part: float = 0.0) -> None:
        super().__init__(problem, remedy=remedy)
        self.part = part
