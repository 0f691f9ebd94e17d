"""pkmcal check: whether the robot is still calibrated, by a few shots, and its repair."""

from dataclasses import asdict

import typer

from app.console import DECISIONS, OPEN, Terminal, terminal_of
from app.exits import Exit
from app.measuring import measure
from app.next import tell_next
from app.options import Anew, Dry, Folder, Json, Plain, Yes
from app.report.identification_text import show
from app.run_text import DeviceIdentities, briefing
from campaigns.campaign import Campaign, open_campaign
from campaigns.evaluation.calibration_check import CalibrationCheck, PartChange
from campaigns.files.table import Column, words
from campaigns.identification.result import RecordedIdentification
from campaigns.journal.journal import Journal
from campaigns.options import CheckOptions
from campaigns.workflow.checking import check_work, record_check, record_repair
from campaigns.workflow.running import run_preview
from campaigns.workflow.validation import seconds_of

PARTS: tuple[Column[PartChange], ...] = (
    words("", lambda part: part.part),
    Column("changed by", lambda part: part.size, decimals=4, signed=True),
    Column("U", lambda part: part.expanded_uncertainty, decimals=4),
    words("unit", lambda part: part.unit),
)


def command(
    context: typer.Context,
    folder: Folder,
    options: CheckOptions,
    *,
    dry: Dry = False,
    yes: Yes = False,
    anew: Anew = False,
    plain: Plain = False,
    json: Json = False,
) -> None:
    """Test with a few shots whether the robot is still calibrated.

    The shots are chosen, given the last identification, so that changes of encoders, arms and the
    tracker's stand are least often mistaken for one another. The tracker may stand anywhere, but
    must not move during the check. If the shots disagree with the stored parameters, the part that
    changed is named, with its size and U (k = 2): an encoder, an arm, a forearm, a mount, warmth,
    or the tracker's stand. Known nests are measured afterwards, and show whether the base has
    moved.

    --repair takes six more shots and identifies the named part again; everything else stays as the
    last identification found it. The new parameters are exported, loaded and rolled back as usual.

    Exit code 1: not good, or not decided.
    """
    terminal, campaign = terminal_of(context, as_json=json), open_campaign(folder)
    campaign.require_devices()
    with terminal.refusals_documented():
        work = check_work(campaign, options)
    if dry:
        terminal.say(f"would measure {len(work.steps)} shots; nothing was moved")
        terminal.document({"stage": work.stage, "shots": len(work.steps)})
        return

    def told(devices: DeviceIdentities) -> str:
        preview = run_preview(campaign, seconds_of(campaign, work), work, anew=anew)
        return f"{work.stage.capitalize()}: {briefing(campaign, work, preview, devices)}"

    def finish(journal: Journal, series: int) -> CalibrationCheck | RecordedIdentification:
        record = record_repair if options.repair else record_check
        return record(campaign, journal, series)

    found = measure(
        campaign,
        lambda _: work,
        finish,
        terminal,
        title=work.stage,
        stage=work.stage,
        retry=options.retry,
        told=told,
        yes=yes,
        anew=anew,
        plain=plain,
    )
    if isinstance(found, CalibrationCheck):
        _show_check(terminal, campaign, found)
        good = found.decision == "pass"
    else:
        show(terminal, found, campaign.robot.mechanism.parameters)
        terminal.document(found.document() | tell_next(terminal, campaign))
        good = found.verdict == "pass"
    if not good:
        raise typer.Exit(Exit.NOT_GOOD)


def _show_check(terminal: Terminal, campaign: Campaign, found: CalibrationCheck) -> None:
    """Judgement for people and for programs, and the next command."""
    terminal.rows("Each part, if it alone had changed", PARTS, found.parts)
    terminal.say(
        f"{found.shots} shots: coordinates misfit by {found.misfit_mm:.4f} mm rms, expected "
        f"{found.expected_mm:.4f} (χ² {found.chi2:.0f} with {found.dof} degrees of freedom)"
    )
    told = found.decision == "pass" and found.base is not None and found.base.decision != "pass"
    terminal.say(found.says, OPEN if told else DECISIONS[found.decision])
    terminal.document(asdict(found) | tell_next(terminal, campaign))
