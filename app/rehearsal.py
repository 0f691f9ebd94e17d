"""Rehearsal: the whole workflow on a simulated cell, for `dry-run` and the paper's example."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from app.console import Terminal
from app.measuring import ValidationJob, measure, run_plan
from app.plan_text import plan_line
from app.report.terminal_text import show_gain, show_identification
from app.wiring import connected_robot, scenario_of
from campaigns.assessment import evaluate
from campaigns.campaign import Campaign
from campaigns.evaluation.simulated_devices import OWN_EQUATIONS
from campaigns.evaluation.validation import ValidationResult
from campaigns.identification.options import IdentificationOptions
from campaigns.kinematics.catalog import MECHANISMS
from campaigns.next_step import state_of
from campaigns.options import LoadOptions, ValidationOptions, ValidationStage
from campaigns.workflow.exporting import export, export_plain
from campaigns.workflow.identification import identify
from campaigns.workflow.loading import load
from campaigns.workflow.planning import plan
from campaigns.workflow.validation import Validated

STAGES = 8
"""Stages of a dry run: those of `rehearse`, and the report."""


@dataclass(slots=True)
class Rehearsal:
    """Answers of the steps of a rehearsal; None for a step that was not reached."""

    scenario: str
    seed: int
    before: Mapping[str, object] | None = None
    after: Mapping[str, object] | None = None
    identification: Mapping[str, object] | None = None
    parameter_file: Path | None = None
    report: Path | None = None
    seconds: float = 0.0


def rehearse(
    campaign: Campaign, terminal: Terminal, options: IdentificationOptions
) -> tuple[Rehearsal, tuple[str, ...]]:
    """Take all steps but the report; return their answers, and the reasons against the result.

    `options` are those of the identification.
    """
    rehearsal = _announce(campaign, terminal)
    heading(terminal, 1, "plan")
    checked = plan(campaign).checked
    terminal.say(plan_line(checked))
    heading(terminal, 2, "validate before")
    before = _validate(campaign, terminal, "before")
    rehearsal.before = before.result.document()
    heading(terminal, 3, "run")
    run_plan(campaign, checked, terminal)
    heading(terminal, 4, "identify")
    identified = identify(campaign, options)
    rehearsal.identification = identified.document()
    show_identification(terminal, identified, campaign.robot.mechanism.parameters)
    if identified.judgement.verdict != "pass":  # such parameters are neither exported nor loaded
        return rehearsal, identified.judgement.reasons
    heading(terminal, 5, "export")
    if state_of(evaluate(campaign)).to_export == "plain":
        path = export_plain(campaign).path
        terminal.say(f"the controller takes no tilts and skews: {path.name}")
    else:
        path, _ = export(campaign)
        terminal.say(path.name)
    rehearsal.parameter_file = path
    heading(terminal, 6, "load")
    kept = load(campaign, connected_robot(campaign), LoadOptions(file=path)).kept
    terminal.say(f"written, read back and compared; the old ones: {kept.name if kept else '-'}")
    heading(terminal, 7, "validate after")
    after = _validate(campaign, terminal, "after")
    rehearsal.after = after.result.document()
    if terminal.is_verbose:
        show_gain(terminal, after.evaluation)
    of_campaign = after.differing_verdict
    return rehearsal, after.verdict.reasons or (of_campaign.reasons if of_campaign else ())


def heading(terminal: Terminal, number: int, stage: str) -> None:
    """Print which stage begins."""
    terminal.say("")
    terminal.say(f"{number}/{STAGES} {stage}", "bold cyan")


def _validate(campaign: Campaign, terminal: Terminal, stage: ValidationStage) -> Validated:
    """Measure a validation as `pkmcal validate --yes` does, and print its distance errors."""
    with connected_robot(campaign) as controller:
        held = controller.read_geometry()
    job = ValidationJob(campaign, terminal, ValidationOptions(stage=stage), held)
    validated = measure(job, terminal, yes=True, plain=True)
    terminal.say(_distance_line(validated.result))
    return validated


def _announce(campaign: Campaign, terminal: Terminal) -> Rehearsal:
    """Print scenario, seed and folder, and return the empty answers."""
    scenario = scenario_of(campaign.folder, campaign.config.controller.url)
    terminal.say(f"dry run of {scenario.name}, seed {scenario.seed}, in {campaign.folder}", "bold")
    if campaign.robot.mechanism.name not in MECHANISMS:
        terminal.say(OWN_EQUATIONS)
    return Rehearsal(scenario.name, scenario.seed)


def _distance_line(result: ValidationResult) -> str:
    """Return the mean and the largest error of distances in a line."""
    distances = result.distances
    if distances is None:
        return "no distances measured"
    return (
        f"distances of hold-out pairs off by {distances.mean.value_mm:.3f} mm on average, "
        f"{distances.largest.value_mm:.3f} mm at most"
    )
