"""pkmcal validate: how good the robot is, as its user commands it."""

import shlex
from enum import StrEnum
from typing import Annotated

import typer

from app.console import WARNING, terminal_of
from app.measuring import measure_validation
from app.options import Anew, Dry, Folder, Json, Yes
from app.report.validation_text import show_validation
from app.wiring import connected_robot
from campaigns.campaign import open_campaign
from campaigns.controllers.export import CalibrationRoute
from campaigns.evaluation.validation import SET_OF
from campaigns.workflow import validation

CLEAR = (
    "Validation '{stage}', {speed} speed, controller {serial}: the robot will move. "
    "Is the cell clear?"
)
Test = StrEnum("Test", {name: name for name in SET_OF})  # type: ignore[misc] # words of the tests
KNOWN = ", ".join(SET_OF)
Stage = Annotated[validation.ValidationStage, typer.Option(help="Before or after `pkmcal load`.")]
Only = Annotated[
    list[Test] | None, typer.Option(metavar="TEST", help=f"Only this test; repeatable: {KNOWN}.")
]
Anyway = Annotated[
    bool,
    typer.Option("--anyway", help="Measure though it is the wrong stage, or 'before' is measured."),
]


By = Annotated[
    CalibrationRoute,
    typer.Option(
        help="What calibrates the robot, --stage after: parameters in its controller, or targets "
        "corrected for a controller that keeps the nominal ones."
    ),
]


def command(
    context: typer.Context,
    folder: Folder,
    *,
    stage: Stage,
    only: Only = None,
    dry: Dry = False,
    yes: Yes = False,
    anew: Anew = False,
    anyway: Anyway = False,
    by: By = "parameters",
    json: Json = False,
) -> None:
    """Measure how good the robot is, as its user commands it.

    Distances between the plan's validation pairs; how far the point strays while only the plate
    turns; how straight lines along x, y and z are; repeatability of approaches from all sides;
    and, from the same shots as the distances, absolute accuracy in the tracker's frame. Poses
    are commanded, so the controller's own parameters are put to the test. What it holds is read
    first: the nominal parameters are not "after", any but the nominal ones not "before". What was
    measured before calibration is measured again only with consent.

    With --by targets nothing is loaded: the controller keeps its nominal parameters, corrected
    poses are commanded, as `pkmcal correct` writes them, and errors are judged against the wanted
    ones.

    Exit code 1: a limit under `acceptance` in campaign.yaml is not surely kept, distances after
    loading are worse than before, or, --stage after, the campaign as a whole does not pass. That no
    limit is asked for is told, and is no 1.
    """
    terminal = terminal_of(context, as_json=json)
    campaign = open_campaign(folder)
    names = [str(name) for name in only or SET_OF]
    validation.require_means(stage, by)
    if dry:
        terminal.say(f"would measure, as '{stage}': {', '.join(names)}; nothing was moved")
        terminal.document({"stage": stage, "tests": names})
        return
    tests = frozenset(SET_OF[name] for name in names)
    again = validation.replaced(campaign, stage, tests)
    if again and not anyway and not terminal.asks(f"{again.problem}. Measure it again?"):
        raise again
    with connected_robot(campaign) as controller:
        wrong = validation.wrong_stage(
            campaign, controller.read_geometry(), stage, terminal.note, by=by
        )
        serial = controller.identity().serial
    if wrong is not None and not anyway:
        raise wrong
    speed_percent = campaign.config.controller.speed_percent
    question = CLEAR.format(stage=stage, speed=f"{speed_percent:g} %", serial=serial)
    terminal.require_yes(question, yes=yes)
    for each in filter(None, (again, wrong)):
        terminal.note(f"! {each.problem}", WARNING)
    validation.require_or_record(campaign, (again, wrong), anyway=True)
    wanted = () if {*names} == {*SET_OF} else names
    words = [word for name in wanted for word in ("--only", name)]
    words += ["--anyway"] if anyway else []
    words += ["--by", by] if by == "targets" else []
    found = measure_validation(
        campaign,
        stage,
        terminal,
        tests,
        again=shlex.join(["pkmcal", "validate", str(folder), "--stage", stage, *words]),
        anew=anew,
        by=by,
    )
    show_validation(terminal, found, campaign)
