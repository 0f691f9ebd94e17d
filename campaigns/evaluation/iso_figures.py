"""Figures of ISO 9283: AP and RP of the test `iso9283`, measured as the standard asks.

A figure has the standard's name only if it was measured by the standard's procedure. Each row
therefore says how it was tested here, and what the standard asks for.
"""

from dataclasses import dataclass

from campaigns.evaluation.measured_lengths import MeasuredLength
from campaigns.evaluation.validation import CUBE_FIGURES, RepeatabilityTest, ValidationResult

NO_FRAME = "not formed: too few commanded points for a base frame"
FIVE_POSES = "30 visits from one direction to each of five poses"
AP = f"AP (7.2.1): {FIVE_POSES}, in a base frame known beforehand"
RP = f"RP (7.2.2): {FIVE_POSES}"


@dataclass(frozen=True, slots=True)
class IsoRow:
    """Figure of the standard, how it was tested here, and what the standard asks for."""

    name: str
    figure: MeasuredLength | None
    n: int
    """Number of visits to each pose."""
    tested: str
    """How it was tested here."""
    asked: str
    """Procedure of the standard."""


def cube_poses(**stages: ValidationResult | None) -> tuple[tuple[str, str, RepeatabilityTest], ...]:
    """Return the stage, name and visits of each of the standard's poses, P1 to P5."""
    return tuple(
        (stage, f"P{number}", pose)
        for stage, result in stages.items()
        for number, pose in enumerate(result.cube if result else (), start=1)
    )


def cube_frame(result: ValidationResult) -> str:
    """Return in words the frame of AP: fitted to the pairs where they are of the same series."""
    # AP needs a base frame that is independent of the poses it judges; a frame fitted to the five
    # poses alone takes part of their error away, and the row says so.
    if not result.cube[0].in_base:
        return NO_FRAME
    pairs, cube = (result.series.get(name) for name in ("distances", "iso9283"))
    points = "the pairs" if pairs is not None and pairs == cube else "these poses alone"
    return f"frame fitted to {points}"


def iso_rows(result: ValidationResult) -> tuple[IsoRow, ...]:
    """Return AP and RP of the standard's five poses, the worst of each; none where not measured."""
    if not result.cube:
        return ()
    visits = min(len(pose.points_mm) for pose in result.cube)
    how = f"{visits} visits from one direction to each of {len(result.cube)} poses"
    accuracy, rp = result.worst_of_cube
    return (
        IsoRow(CUBE_FIGURES[0], accuracy, visits, f"{how}; {cube_frame(result)}", AP),
        IsoRow(CUBE_FIGURES[1], rp, visits, how, RP),
    )
