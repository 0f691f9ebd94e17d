"""pkmcal validate: how good the robot is, as its user commands it."""

from enum import Enum
from typing import TYPE_CHECKING, Annotated

import typer

from app.exits import Exit
from app.options import Anew, Dry, Folder, Json, Yes

if TYPE_CHECKING:
    from collections.abc import Sequence

    from app.console import Terminal
    from app.folder import Campaign
    from campaigns.journal import Journal
    from campaigns.plan_file import PlannedShot
    from campaigns.session import Work
    from campaigns.shooting import Cell
    from campaigns.shot_sets import ShotSet
    from campaigns.validate import Validation


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


def command(
    context: typer.Context,
    folder: Folder,
    *,
    stage: Annotated[When, typer.Option(help="Before or after `pkmcal load`.")],
    only: Annotated[
        list[Test] | None, typer.Option(help="Only this test; may be given several times.")
    ] = None,
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
    from app.commands.run import CLEAR
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
    from app.measuring import measure
    from campaigns.records import Finding
    from campaigns.validate import broken_limits, evaluate

    def prepare(cell: "Cell") -> "Work":
        return validation_work(campaign, stage, tests, cell, terminal)

    def finish(journal: "Journal", series: int) -> "tuple[Validation, list[str]]":
        found = evaluate(journal.shots(series))
        against = broken_limits(found, campaign.config.acceptance)
        if stage is When.AFTER:
            against += worse_than_before(found, journal)
        body = {"stage": stage.value, "series": series, **found.document()}
        journal.append(Finding("validation", body), series=series)
        return found, against

    title = f"validate {stage.value}"
    return measure(campaign, prepare, finish, terminal, title=title, anew=anew)


def worse_than_before(found: "Validation", journal: "Journal") -> list[str]:
    """Whether distances are worse than the latest validation before loading found them."""
    from campaigns.records import Finding

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


def validation_work(
    campaign: "Campaign",
    stage: When,
    tests: tuple[Test, ...],
    cell: "Cell",
    terminal: "Terminal",
) -> "Work":
    """The tests as work for the engine, planned with the geometry that the controller holds."""
    import numpy as np

    from app.console import WARNING
    from app.setup import mechanism_of, view_of
    from campaigns.numerics.geometry import Geometry
    from campaigns.plan_file import plan_digest
    from campaigns.planning import numeric_limits
    from campaigns.robot import RobotFile
    from campaigns.rules import gate_rules, motion_rules
    from campaigns.session import Work
    from campaigns.validation_plan import Reachable, validation_steps

    active = cell.robot.read_geometry()
    geometry = Geometry.from_flat(active)
    limits = campaign.nominal.robot.limits
    planned = validation_steps(
        campaign.config.validation,
        _pairs(campaign, tests),
        Reachable(geometry, numeric_limits(campaign.nominal.robot), view_of(campaign)),
        _sets(tests),
        np.random.default_rng(campaign.config.plan.seed),
    )
    for note in planned.notes:
        terminal.note(f"! {note}", WARNING)
    return Work(
        stage.value,
        planned.steps,
        plan_digest([step.planned for step in planned.steps]),
        RobotFile.from_flat(active, name="active", limits=limits).digest(),
        campaign.config.model_dump(mode="json"),
        mechanism_of(campaign, geometry),
        motion_rules(campaign.config),
        gate_rules(campaign.config),
    )


def _sets(tests: tuple[Test, ...]) -> "frozenset[ShotSet]":
    from campaigns.shot_sets import ShotSet

    of_test = {
        Test.DISTANCES: ShotSet.VALIDATION,
        Test.ROTATION: ShotSet.ROTATION,
        Test.STRAIGHTNESS: ShotSet.STRAIGHTNESS,
        Test.REPEATABILITY: ShotSet.REPEATABILITY,
    }
    return frozenset(of_test[test] for test in tests)


def _pairs(campaign: "Campaign", tests: tuple[Test, ...]) -> "list[PlannedShot]":
    """The plan's validation shots, where they are wanted."""
    from campaigns.plan_file import read_plan
    from campaigns.shot_sets import ShotSet

    if Test.DISTANCES not in tests:
        return []
    return [s for s in read_plan(campaign.plan_path) if s.purpose is ShotSet.VALIDATION]


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
