"""pkmcal identify: find the parameters that explain the measured shots."""

from typing import Annotated

import typer

from app.console import Terminal
from app.next import tell_next
from app.report.terminal_text import show_identification
from campaigns.assessment import evaluate
from campaigns.campaign import Campaign
from campaigns.chain import checks_of_instrument
from campaigns.identification.options import IdentificationOptions
from campaigns.workflow.checking import update_by_check
from campaigns.workflow.identification import identify


def command(
    terminal: Terminal,
    campaign: Campaign,
    options: IdentificationOptions,
    *,
    update: Annotated[
        bool,
        typer.Option("--update", help="Update the last result by the shots of the latest check."),
    ] = False,
) -> None:
    """Find the parameters that explain the measured shots.

    Uses the latest run or import, and imported observations of other kinds than points, which are
    fitted alone if no tracker measured. The fit uses the shots of the set "identification" and is
    judged by the pairs of the set "validation", which it never uses. Every source of error is
    fitted, with its tolerance as a prior; what no shot determines stays at nominal. A NAME is a
    parameter, a shell pattern of parameters, or a group of error sources, such as backlash.

    Exit code 1: computed, but must not be used; the reasons are given.

    pkmcal identify cell-3
    pkmcal identify cell-3 --only-shots 0-60 --fix eccentricity
    pkmcal identify cell-3 --hold-out 20%
    pkmcal identify printer --hold-out 20% --for flat,xy
    """
    with terminal.telling("identifying") as now_at:
        result = update_by_check(campaign) if update else identify(campaign, options, now_at)
    terminal.detail(f"model {result.provenance.model}, {result.provenance.seconds:.2f} s")
    evaluation = evaluate(campaign)
    # a limit of the tracker that was changed after the measurement has no effect: say why
    evidence = evaluation.evidence
    of_instrument = [f"{check.denied}: {check.detail}" for check in checks_of_instrument(evidence)]
    warnings = *of_instrument, *evidence.warnings
    show_identification(terminal, result, campaign.robot.mechanism.parameters, warnings)
    following = tell_next(terminal, campaign, evaluation=evaluation)
    terminal.conclude(result.document(), following, is_good=result.judgement.verdict == "pass")
