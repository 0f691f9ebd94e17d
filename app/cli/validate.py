"""pkmcal validate: measure how accurate the robot is as its user commands it."""

from dataclasses import dataclass, replace

from app.console import WARNING, Terminal
from app.measuring import ValidationJob, measure
from app.next import tell_next, tell_source_of_u
from app.options import Anew, Dry, Plain, Yes
from app.report.terminal_text import show_validation
from app.wiring import connected_robot
from campaigns.campaign import Campaign
from campaigns.evaluation.validation import BY_DEFAULT
from campaigns.options import ValidationOptions, ValidationTest
from campaigns.workflow import validation

BY_HAND_TESTS = (ValidationTest("distances"),)
"""Tests by default where each shot is taken by hand."""
ONLY_DISTANCES = "by hand only distances are tested; `--only rotation` and others test more"
NO_LIMITS = (
    "! no limits are specified under acceptance in campaign.yaml: errors will be stated, but no "
    "conformity; limits that are set later are judged at once"
)


@dataclass(frozen=True, slots=True)
class ValidationPreview:
    """Answer of `validate --dry`."""

    stage: str
    tests: tuple[str, ...]


def command(
    terminal: Terminal,
    campaign: Campaign,
    options: ValidationOptions,
    *,
    dry: Dry = False,
    yes: Yes = False,
    anew: Anew = False,
    plain: Plain = False,
) -> None:
    """Measure how accurate the robot is as its user commands it.

    The tests: distances between the plan's validation pairs; motion of the point while only the
    plate turns; straightness along x, y and z; repeatability of approaches from all sides; and,
    from the shots of the distances, absolute accuracy in the tracker's frame. With --only iso9283,
    pose accuracy AP and repeatability RP as the standard defines them: 30 visits from one direction
    to each of five poses in the largest cube; together with --only distances, the base frame is
    that of the pairs. Poses are commanded, so the controller's own parameters are tested. They are
    read first: with the nominal parameters --stage after is refused, with any others --stage
    before. Tests measured before calibration are measured again only with consent.

    By hand only distances are tested, unless --only names other tests.

    With --by targets nothing is loaded: the controller keeps its nominal parameters, corrected
    poses are commanded, as `pkmcal correct` writes them, and errors are relative to the wanted
    poses.

    Exit code 1, with --stage after alone: a limit under `acceptance` in campaign.yaml is not met
    beyond doubt, distances are worse than before, or the campaign as a whole does not pass. A
    missing limit is reported, but is no reason for exit code 1. Before calibration errors are only
    stated.
    """
    campaign.require_devices()
    if campaign.is_by_hand and not options.only:
        options = replace(options, only=BY_HAND_TESTS)
        terminal.note(ONLY_DISTANCES)
    stage, names = options.stage, tuple(str(name) for name in options.only or BY_DEFAULT)
    if dry:
        terminal.say(f"would measure, as '{stage}': {', '.join(names)}; nothing was moved")
        terminal.conclude(ValidationPreview(stage, names), tell_next(terminal, campaign))
        return
    if stage == "after" and not any(campaign.config.acceptance.model_dump().values()):
        terminal.note(NO_LIMITS, WARNING)
    tell_source_of_u(terminal, campaign)
    # 1. tests that are measured already: their results would be replaced
    replaced = validation.replaced(campaign, stage, options.tests)
    if replaced and not options.force:
        question = f"{replaced.problem}. Measure it again?"
        if not terminal.asks(question):
            raise replaced
    # 2. the controller's parameters contradict the stage: with the nominal ones it is not "after"
    # (held: another command that measures has the controller for itself)
    with campaign.held(), connected_robot(campaign) as controller:
        held = controller.read_geometry()
    wrong = validation.wrong_stage(campaign, held, stage, terminal.note, by=options.by)
    if wrong is not None and not options.force:
        raise wrong
    # 3. both kinds of objection can be overridden, and are recorded in the journal then
    objections = [*filter(None, (replaced, wrong))]
    for objection in objections:
        terminal.note(f"! {objection.problem}", WARNING)
    job = ValidationJob(campaign, terminal, options, held, objections, anew=anew)
    validated = measure(job, terminal, yes=yes, anew=anew, plain=plain)
    show_validation(terminal, validated, campaign)
