"""pkmcal check: whether the robot is still calibrated, by a few shots."""

from dataclasses import asdict
from functools import partial

import typer

from app.console import DECISIONS, Terminal, terminal_of
from app.exits import Exit
from app.measuring import measure
from app.next import tell_next
from app.options import Anew, Dry, Folder, Json, Plain, Yes
from app.run_text import DeviceIdentities, briefing
from campaigns.campaign import Campaign, open_campaign
from campaigns.evaluation.calibration_check import CalibrationCheck, PartChange
from campaigns.files.table import Column, words
from campaigns.options import CheckOptions
from campaigns.workflow.checking import check_work, record_check
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

    Measures identification shots of plan.csv again, spread evenly over it. The tracker may stand
    anywhere, but must not move during the check. If the shots disagree with the stored parameters,
    the part that changed is named, with its size and U (k = 2): an encoder, an arm, a forearm, a
    mount, warmth, or the tracker's stand.

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

    found = measure(
        campaign,
        lambda _: work,
        partial(record_check, campaign),
        terminal,
        title=work.stage,
        stage=work.stage,
        retry=options.retry,
        told=told,
        yes=yes,
        anew=anew,
        plain=plain,
    )
    _show_check(terminal, campaign, found)
    if found.decision != "pass":
        raise typer.Exit(Exit.NOT_GOOD)


def _show_check(terminal: Terminal, campaign: Campaign, found: CalibrationCheck) -> None:
    """Judgement for people and for programs, and the next command."""
    terminal.rows("Each part, if it alone had changed", PARTS, found.parts)
    terminal.say(
        f"{found.shots} shots: coordinates misfit by {found.misfit_mm:.4f} mm rms, expected "
        f"{found.expected_mm:.4f} (χ² {found.chi2:.0f} with {found.dof} degrees of freedom)"
    )
    terminal.say(found.says, DECISIONS[found.decision])
    terminal.document(asdict(found) | tell_next(terminal, campaign))
