"""Results of an attempt at a shot, which decide how the engine goes on."""

from dataclasses import dataclass
from enum import Enum
from typing import TypeAlias

from campaigns.errors import GateRefused
from campaigns.journal.records import Outcome
from drivers.errors import ExplainedError

SKIPPED = "skipped by the operator"
TAKEN_BACK = "taken back by the operator"


class Loss(Enum):
    """Reasons why an attempt gave no data, as far as the next attempt depends on them."""

    BEAM = "the beam was broken, and the tracker has its reflector again"
    UNSEEN = "the reflector was never seen at this pose"
    TARGET = "the robot cannot be sent there, nor by another attempt"
    MEASUREMENT = "the robot moved, or the result cannot be"


@dataclass(frozen=True, slots=True)
class Accepted:
    """Outcome that agrees with the accepted shots; it is not in the journal yet."""

    outcome: Outcome


@dataclass(frozen=True, slots=True)
class Skipped:
    """The operator leaves the shot out."""

    reason: str = SKIPPED


@dataclass(frozen=True, slots=True)
class TakenBack:
    """The operator wants the last shot again before this one."""

    is_voided: bool = False
    """Whether the last shot was of the same pair, and is void already."""
    reason: str = TAKEN_BACK


@dataclass(frozen=True, slots=True)
class Refused:
    """Point too far from the one that the accepted shots predict."""

    reason: str
    outcome: Outcome
    """Data of the attempt, which the journal has as rejected."""
    relocked: bool
    """Whether the tracker has found a reflector where this pose's should be."""
    attempts: int = 1


@dataclass(frozen=True, slots=True)
class Lost:
    """Attempt without data."""

    reason: str
    loss: Loss
    error: ExplainedError | None = None
    """Error by which the target was refused; None if the attempt failed otherwise."""
    attempts: int = 1


ShotResult: TypeAlias = Accepted | Skipped | TakenBack | Refused | Lost


def failure_of(result: Refused | Lost) -> GateRefused:
    """Return the error of a shot that all attempts have failed to measure, with what helps."""
    error = result.error if isinstance(result, Lost) else None
    if error is None:
        remedy = (
            "look at the reflector, the beam and the robot there; then run again, it resumes. "
            "If an earlier shot took the wrong reflector: start a new series with --anew"
        )
    else:
        remedy = error.remedy
    attempts = f"{result.attempts} attempts" if result.attempts > 1 else "the attempt"
    return GateRefused(f"{attempts} failed, the last one: {result.reason}", remedy=remedy)
