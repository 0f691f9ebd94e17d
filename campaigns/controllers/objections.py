"""Objections to a load: each has a name, by which an operator overrules it and no other."""

from dataclasses import dataclass
from enum import StrEnum


class ObjectionName(StrEnum):
    """Name of an objection, as `load --force NAME` takes it."""

    ORIGIN = "origin"
    """The file does not say which identification its parameters are of."""
    IDENTITY = "identity"
    """The file of another campaign, or of an identification that this journal does not hold."""
    CHANGED = "changed"
    """The parameters are none that this campaign has identified or exported."""
    SUPERSEDED = "superseded"
    """The file of an earlier identification."""
    NOMINAL = "nominal"
    """The file rests on another nominal robot."""
    VERDICT = "verdict"
    """The identification did not pass."""
    FAR = "far-from-nominal"
    """A parameter of the file is beyond the robot's tolerance."""
    SERIAL = "serial"
    """The set is for another controller than the connected one."""
    HELD = "held"
    """What the controller holds is beyond the robot's tolerance, and would be backed up."""


@dataclass(frozen=True, slots=True)
class Objection:
    """Reason not to load a file, and what to do instead of overruling it."""

    name: ObjectionName
    problem: str
    remedy: str

    @property
    def says(self) -> str:
        """Name and problem, as the journal keeps an overruled objection."""
        return f"{self.name}: {self.problem}"
