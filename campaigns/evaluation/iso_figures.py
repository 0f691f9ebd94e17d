"""Figures of ISO 9283: AP and RP of the test `iso9283`, made as the standard makes it."""

from dataclasses import dataclass

from campaigns.evaluation.validation import (
    CUBE_FIGURES,
    MeasuredLength,
    RepeatabilityTest,
    ValidationResult,
)

NO_FRAME = "not formed: too few commanded points for a base frame"
FIVE_POSES = "30 visits from one direction to each of five poses"
AP = f"AP (7.2.1): {FIVE_POSES}, in a base frame known beforehand"
RP = f"RP (7.2.2): {FIVE_POSES}"


@dataclass(frozen=True, slots=True)
class IsoRow:
    """Figure under its own name, or why there is none, and what the standard asks for instead."""

    name: str
    figure: MeasuredLength | None
    n: int
    """Repetitions: visits, or cycles of a path."""
    tested: str
    """How it was tested here."""
    asked: str


def cube_poses(**stages: ValidationResult | None) -> tuple[tuple[str, str, RepeatabilityTest], ...]:
    """Return the stage, name and visits of each of the standard's poses, P1 to P5."""
    return tuple(
        (stage, f"P{number}", pose)
        for stage, result in stages.items()
        for number, pose in enumerate(result.cube if result else (), start=1)
    )


def cube_frame(result: ValidationResult) -> str:
    """Return the frame of AP: that of the pairs where they are of the same series."""
    if not result.cube[0].in_base:
        return NO_FRAME
    pairs, cube = (result.series.get(name) for name in ("distances", "iso9283"))
    of = "the pairs" if pairs is not None and pairs == cube else "these poses alone"
    return f"frame fitted to {of}"


def iso_rows(result: ValidationResult) -> tuple[IsoRow, ...]:
    """Return AP and RP of the standard's five poses, the worst of each; none where not measured."""
    if not result.cube:
        return ()
    visits = min(len(each.points_mm) for each in result.cube)
    how = f"{visits} visits from one direction to each of {len(result.cube)} poses"
    accuracy, rp = result.worst_of_cube
    return (
        IsoRow(CUBE_FIGURES[0], accuracy, visits, f"{how}; {cube_frame(result)}", AP),
        IsoRow(CUBE_FIGURES[1], rp, visits, how, RP),
    )
