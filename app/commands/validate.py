"""pkmcal validate: how good the robot is, as its user commands it."""

from enum import Enum
from typing import TYPE_CHECKING, Annotated

import typer

from app.exits import Exit
from app.options import Anew, Dry, Folder, Json, Yes

if TYPE_CHECKING:
    from collections.abc import Mapping

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
    folder: Folder,
    *,
    stage: Annotated[When, typer.Option(help="Before or after loading the identified parameters.")],
    only: Annotated[
        list[Test] | None, typer.Option(help="Only this test; may be given several times.")
    ] = None,
    dry: Dry = False,
    yes: Yes = False,
    anew: Anew = False,
    json: Json = False,
) -> None:
    """Measure distances, rotation, straightness and repeatability with the controller's own model.

    Poses are commanded, so what is tested is what a user of the robot gets. Limits under
    `acceptance` in campaign.yaml decide about the exit code.
    """
    from app.console import Terminal
    from app.folder import open_campaign

    terminal = Terminal(as_json=json)
    campaign = open_campaign(folder)
    tests = tuple(only or Test)
    if dry:
        terminal.say(f"{stage.value}: would measure {', '.join(t.value for t in tests)}")
        terminal.document({"stage": stage.value, "tests": [t.value for t in tests]})
        return
    if not yes and not terminal.confirm("The robot will move. Is the cell clear?"):
        raise typer.BadParameter("not confirmed: answer y, or give --yes")
    found, broken = validate(campaign, stage, tests, terminal, anew=anew)
    terminal.document(found.document())
    if broken:
        raise typer.Exit(Exit.NOT_GOOD)


def validate(
    campaign: "Campaign",
    stage: When,
    tests: tuple[Test, ...],
    terminal: "Terminal",
    *,
    anew: bool = False,
) -> "tuple[Validation, list[str]]":
    """Measure and evaluate; gives the results and the acceptance limits they break."""
    from app.measuring import measure
    from campaigns.records import Finding
    from campaigns.validate import broken_limits, evaluate

    results: list[Validation] = []

    def prepare(cell: "Cell") -> "Work":
        return validation_work(campaign, stage, tests, cell, terminal)

    def finish(journal: "Journal", series: int) -> None:
        results.append(evaluate(journal.shots(series)))
        body = {"stage": stage.value, "series": series, **results[0].document()}
        journal.append(Finding("validation", body), series=series)

    title = f"validate {stage.value}"
    measure(campaign, prepare, finish, terminal, title=title, anew=anew)
    found = results[0]
    broken = broken_limits(found, campaign.config.acceptance)
    show(terminal, stage, found, broken)
    return found, broken


def validation_work(
    campaign: "Campaign",
    stage: When,
    tests: tuple[Test, ...],
    cell: "Cell",
    terminal: "Terminal",
) -> "Work":
    """The tests as work for the engine, planned with the geometry that the controller holds."""
    import numpy as np

    from app.setup import mechanism_of
    from campaigns.numerics.geometry import Geometry
    from campaigns.plan_file import plan_digest
    from campaigns.planning import numeric_limits
    from campaigns.robot import RobotFile
    from campaigns.rules import gate_rules, motion_rules
    from campaigns.plan_file import PlannedShot
    from campaigns.session import Work
    from campaigns.validation_plan import Reachable, validation_steps

    active = cell.robot.read_geometry()
    geometry = Geometry.from_flat(active)
    limits = campaign.nominal.robot.limits
    planned = validation_steps(
        campaign.config.validation,
        _validation_shots(campaign),
        Reachable(geometry, numeric_limits(campaign.nominal.robot)),
        _sets(tests),
        np.random.default_rng(campaign.config.plan.seed),
    )
    for note in planned.notes:
        terminal.note(f"! {note}", "yellow")
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

    of_test: Mapping[Test, ShotSet] = {
        Test.DISTANCES: ShotSet.VALIDATION,
        Test.ROTATION: ShotSet.ROTATION,
        Test.STRAIGHTNESS: ShotSet.STRAIGHTNESS,
        Test.REPEATABILITY: ShotSet.REPEATABILITY,
    }
    return frozenset(of_test[test] for test in tests)


def _validation_shots(campaign: "Campaign") -> "list[PlannedShot]":
    from campaigns.plan_file import read_plan
    from campaigns.shot_sets import ShotSet

    return [s for s in read_plan(campaign.plan_path) if s.purpose is ShotSet.VALIDATION]


def show(terminal: "Terminal", stage: When, found: "Validation", broken: list[str]) -> None:
    """The results for people."""
    from app.console import BAD

    rows = result_rows(found)
    terminal.table(f"Validation, {stage.value} (mm)", ("", stage.value), rows)
    for line in broken:
        terminal.say(f"beyond the acceptance limit: {line}", BAD)


def result_rows(found: "Validation") -> list[tuple[str, str]]:
    """One row a figure; `-` for a test that was not run."""
    distances, repeated, frame = found.distances, found.repeatability, found.frame
    straight = found.straightness_mm or {}
    return [
        ("distances: mean error", _mm(distances.mean_abs if distances else None)),
        ("distances: max error", _mm(distances.max_abs if distances else None)),
        ("rotation", _mm(found.rotation_mm)),
        *((f"straightness {axis}", _mm(straight.get(axis))) for axis in ("x", "y", "z")),
        ("repeatability: radius", _mm(repeated.radius_mm if repeated else None)),
        ("repeatability: RP", _mm(repeated.rp_mm if repeated else None)),
        ("in the tracker's frame: mean", _mm(frame.mean if frame else None)),
        ("in the tracker's frame: max", _mm(frame.max if frame else None)),
    ]


def _mm(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"
