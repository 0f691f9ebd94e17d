"""Attempts at a shot or a pair: as many as are allowed; a broken beam counts none."""

from collections.abc import Callable
from typing import TypeVar

from campaigns.errors import GateRefused
from campaigns.measuring.reacquisition import Reacquisition
from campaigns.measuring.shot_taker import (
    BeamReturned,
    ReflectorUnseen,
    ShotFailed,
    ShotRefused,
    TargetRefused,
)

FORGIVEN_BREAKS = 10
"""Breaks of the beam, one after another at one shot, that count no attempt.

A reflector that is found each time and lost each time while it is measured is no passer-by.
"""
Result = TypeVar("Result")


class Attempts:
    """Repeats what gives no data, as often as is allowed."""

    def __init__(self, allowed: int, reacquisition: Reacquisition) -> None:
        self._allowed = allowed
        self._reacquisition = reacquisition

    def insist(self, attempt: Callable[[], Result], allowed: int | None = None) -> Result:
        """Try until there is data; raises `GateRefused`, whose cause is the last `ShotFailed`.

        At once where another attempt could not change anything.
        """
        failures: list[ShotFailed] = []
        breaks = 0
        while len(failures) < (allowed or self._allowed):
            try:
                return attempt()
            except BeamReturned as lost:
                breaks += 1
                failures += [lost] if breaks > FORGIVEN_BREAKS else []
            except ReflectorUnseen as lost:
                failures += [lost] if self._reacquisition.wait_where_it_was() else []
            except ShotFailed as lost:
                failures.append(lost)
                if isinstance(lost, TargetRefused) or _is_hopeless(lost):
                    break
        raise _refused(failures) from failures[-1]


def _is_hopeless(lost: ShotFailed) -> bool:
    """Whether the tracker is still on what was refused: it would be refused again."""
    return isinstance(lost, ShotRefused) and not lost.relocked


def _refused(failures: list[ShotFailed]) -> GateRefused:
    attempts = f"{len(failures)} attempts" if len(failures) > 1 else "the attempt"
    return GateRefused(
        f"{attempts} failed, the last one: {failures[-1]}",
        remedy="look at the reflector, the beam and the robot there; then run again, it resumes. "
        "If an earlier shot took the wrong reflector: begin anew with --anew",
    )
