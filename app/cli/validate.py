"""pkmcal validate: how good the robot is, as its user commands it."""

import shlex
from enum import Enum
from typing import TYPE_CHECKING, Annotated

import typer

from app.exits import Exit
from app.options import Anew, Dry, Folder, Json, Yes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from app.console import Terminal
    from app.folder import Campaign
    from campaigns.evaluation.validation import Validation
    from campaigns.journal.journal import Journal
    from campaigns.measuring.session import Work
    from campaigns.measuring.shot_taker import Cell
    from campaigns.shots.shot_sets import ShotSet


class When(Enum):
    """Before or after the identified parameters are in the controller."""

    BEFORE = "before"
    AFTER = "after"


class Test(Enum):
    """The tests of the paper's section IV.E; the value is the word on the command line."""

    DISTANCES = "distances"
    ROTATION = "rotation"
    STRAIGHTNESS = "straightness"
    REPEATABILITY = "repeatability"


KNOWN = ", ".join(test.value for test in Test)
Only = Annotated[
    list[Test] | None, typer.Option(metavar="TEST", help=f"Only this test; repeatable: {KNOWN}.")
]


def command(
    context: typer.Context,
    folder: Folder,
    *,
    stage: Annotated[When, typer.Option(help="Before or after `pkmcal load`.")],
    only: Only = None,
    dry: Dry = False,
    yes: Yes = False,
    anew: Anew = False,
    json: Json = False,
) -> None:
    """Measure how good the robot is, as its user commands it.

    Distances between the plan's validation pairs; how far the point strays while only the plate
    turns; how straight lines along x, y and z are; repeatability of approaches from all sides;
    and, from the same shots as the distances, absolute accuracy in the tracker's frame. Poses
    are commanded, so the controller's own parameters are put to the test.

    Exit code 1: a limit under `acceptance` in campaign.yaml is broken, or distances after loading
    are worse than before.
    """
    from app.cli.run import CLEAR
    from app.console import terminal_of
    from app.folder import open_campaign

    terminal = terminal_of(context, as_json=json)
    campaign = open_campaign(folder)
    tests = tuple(only or Test)
    names = [test.value for test in tests]
    if dry:
        terminal.say(f"would measure, as '{stage.value}': {', '.join(names)}; nothing was moved")
        terminal.document({"stage": stage.value, "tests": names})
        return
    terminal.require_yes(CLEAR, yes=yes)
    found, against = validate(campaign, stage, tests, terminal, anew=anew)
    show(terminal, stage, found, against)
    terminal.document(found.document())
    if against:
        raise typer.Exit(Exit.NOT_GOOD)


def validate(
    campaign: "Campaign",
    stage: When,
    tests: tuple[Test, ...],
    terminal: "Terminal",
    *,
    anew: bool = False,
) -> "tuple[Validation, list[str]]":
    """Measure and evaluate; gives the results and what speaks against them."""
    from app.console import WARNING
    from app.measuring import measure
    from app.work_builders import validation_work
    from campaigns.evaluation.validation import broken_limits, evaluate_validation
    from campaigns.journal.records import Finding

    def prepare(cell: "Cell") -> "Work":
        active = cell.robot.read_geometry()
        work, notes = validation_work(campaign, stage.value, _sets(tests), active)
        for note in notes:
            terminal.note(f"! {note}", WARNING)
        return work

    def finish(journal: "Journal", series: int) -> "tuple[Validation, list[str]]":
        found = evaluate_validation(journal.shots(series))
        against = broken_limits(found, campaign.config.acceptance)
        if stage is When.AFTER:
            against += worse_than_before(found, journal)
        body = {"stage": stage.value, "series": series, **found.document()}
        journal.append(Finding("validation", body), series=series)
        return found, against

    title = f"validate {stage.value}"
    wanted = () if set(tests) == set(Test) else tests
    only = [word for test in wanted for word in ("--only", test.value)]
    words = ["pkmcal", "validate", str(campaign.folder), "--stage", stage.value, *only]
    again = shlex.join(words)
    return measure(campaign, prepare, finish, terminal, title=title, again=again, anew=anew)


def worse_than_before(found: "Validation", journal: "Journal") -> list[str]:
    """Whether distances are worse than the latest validation before loading found them."""
    from campaigns.journal.records import Finding

    bodies = [entry.record.body for entry in journal.records_of(Finding)]
    known = [b["distances_mm"] for b in bodies if b.get("stage") == When.BEFORE.value]
    before = next((distances for distances in reversed(known) if distances is not None), None)
    if before is None or found.distances is None:
        return []
    assert isinstance(before, dict), "so it was written"
    mean_before, mean_after = float(str(before["mean_abs"])), found.distances.mean_abs
    if mean_after <= mean_before:
        return []
    return [f"mean distance error {mean_after:.3f} mm, before loading it was {mean_before:.3f} mm"]


def _sets(tests: tuple[Test, ...]) -> "frozenset[ShotSet]":
    from campaigns.shots.shot_sets import ShotSet

    of_test = {
        Test.DISTANCES: ShotSet.VALIDATION,
        Test.ROTATION: ShotSet.ROTATION,
        Test.STRAIGHTNESS: ShotSet.STRAIGHTNESS,
        Test.REPEATABILITY: ShotSet.REPEATABILITY,
    }
    return frozenset(of_test[test] for test in tests)


def show(terminal: "Terminal", stage: When, found: "Validation", against: "Sequence[str]") -> None:
    """The results for people."""
    from app.console import BAD

    rows = [(name, in_mm(value)) for name, value in figures(found).items()]
    terminal.table(f"Validation, {stage.value} (mm)", ("", stage.value), rows)
    for line in against:
        terminal.say(f"not good: {line}", BAD)


def figures(found: "Validation") -> dict[str, float | None]:
    """All figures in mm, by their names on the screen; None for a test that was not run."""
    distances, repeated, frame = found.distances, found.repeatability, found.frame
    straight = found.straightness_mm or {}
    return {
        "distances: mean error": distances.mean_abs if distances else None,
        "distances: max error": distances.max_abs if distances else None,
        "rotation": found.rotation_mm,
        **{f"straightness {axis}": straight.get(axis) for axis in ("x", "y", "z")},
        "repeatability: radius": repeated.radius_mm if repeated else None,
        "repeatability: RP": repeated.rp_mm if repeated else None,
        "in the tracker's frame: mean": frame.mean if frame else None,
        "in the tracker's frame: max": frame.max if frame else None,
    }


def in_mm(value: float | None) -> str:
    """A figure as it is shown."""
    return "-" if value is None else f"{value:.3f}"
