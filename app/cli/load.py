"""pkmcal load: the compensated parameters into the controller."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.options import Dry, Folder, Json

if TYPE_CHECKING:
    from collections.abc import Mapping

    from app.console import Terminal
    from app.folder import Campaign
    from campaigns.controllers.load import Change
    from drivers.ports import RobotController

KEPT = "controller-before-{number}.yaml"
SURE = "Write these parameters? The robot must stand still."

Approve = Callable[["tuple[Change, ...]"], bool]


File = Annotated[
    Path | None,
    typer.Option(metavar="FILE", help="Another robot file than DIR/robot-compensated.yaml."),
]
Rollback = Annotated[bool, typer.Option("--rollback", help="Put back what the last load replaced.")]
Standing = Annotated[bool, typer.Option("--yes", "-y", help="Don't ask: the robot stands still.")]


def command(
    context: typer.Context,
    folder: Folder,
    *,
    file: File = None,
    rollback: Rollback = False,
    dry: Dry = False,
    yes: Standing = False,
    json: Json = False,
) -> None:
    """Put the compensated parameters into the controller.

    Shows the difference to what it holds, with Δ/σ, asks, keeps the old as
    controller-before-N.yaml, writes all at once, reads back and compares. What does not verify
    is taken back. Ctrl-C is heard before and after, never in between.
    """
    from app.console import terminal_of
    from app.exits import UsageInvalid
    from app.folder import open_campaign
    from campaigns.controllers.export import FILE_NAME

    terminal = terminal_of(context, as_json=json)
    if rollback and file is not None:
        raise UsageInvalid("--rollback and --file contradict each other", remedy="give one")
    campaign = open_campaign(folder)
    source = last_kept(campaign) if rollback else file or campaign.path(FILE_NAME)

    def approve(found: "tuple[Change, ...]") -> bool:
        show(terminal, found)
        if not dry:
            terminal.require_yes(SURE, yes=yes)
        return not dry

    kept = load(campaign, source, approve)
    if kept is None:
        terminal.say("nothing was written" if dry else "the controller holds these already")
    else:
        terminal.say(f"loaded and verified: {source}", "green")
        terminal.say(f"what it held before: {kept}")
    terminal.document(load_document(source, kept))


def load_document(source: Path, kept: Path | None) -> dict[str, object]:
    """What `--json` prints; nulls when nothing was done."""
    done = kept is not None
    return {"loaded": str(source) if done else None, "kept": str(kept) if done else None}


def load(campaign: "Campaign", source: Path, approve: Approve) -> Path | None:
    """Load a robot file; gives where the old parameters are kept, None when nothing was done.

    `approve` is shown the changes and says whether to go on. Raises `ConfigInvalid` for parameters
    that no controller knows, before anything is connected.
    """
    from app.folder import journal_of
    from app.interrupt import StopRequest, stop_on_signals
    from app.wiring import connected_robot
    from campaigns.controllers.load import changes, differing
    from campaigns.journal.records import Finding
    from campaigns.robots.robot import read_robot

    robot = read_robot(source).robot
    wanted = robot.controller_flat()
    with journal_of(campaign) as journal, connected_robot(campaign) as controller:
        old = dict(controller.read_geometry())
        if not differing(old, wanted):
            return None
        if not approve(changes(old, robot)):
            return None
        wish = StopRequest()
        with stop_on_signals(wish):
            kept = _replace(campaign, controller, wanted, old)
            body = {"source": source.name, "digest": robot.digest(), "kept": kept.name}
            journal.append(Finding("load", body))
    if wish():
        raise KeyboardInterrupt
    return kept


def _replace(
    campaign: "Campaign",
    controller: "RobotController",
    wanted: "Mapping[str, float]",
    old: "Mapping[str, float]",
) -> Path:
    """Keep what the controller holds, then write and verify."""
    from campaigns.controllers.load import write_verified

    kept = keep(campaign, old)
    write_verified(controller, wanted, old)
    return kept


def keep(campaign: "Campaign", old: "Mapping[str, float]") -> Path:
    """Write what the controller holds as a robot file under the next free number."""
    from campaigns.robots.robot import Compensation, compensated, write_new_robot

    number = 1 + max((_number(path) for path in _kept(campaign)), default=0)
    path = campaign.path(KEPT.format(number=number))
    name = f"{campaign.nominal.robot.name}-controller-before-{number}"
    write_new_robot(path, compensated(campaign.nominal, Compensation(name, old, {}, {})))
    return path


def last_kept(campaign: "Campaign") -> Path:
    """The file that the last load kept; raises `ShotsMissing` when there is none."""
    from campaigns.errors import ShotsMissing

    kept = _kept(campaign)
    if not kept:
        raise ShotsMissing(
            f"{campaign.folder}: nothing was loaded here yet",
            remedy="there is nothing to roll back; name a robot file with --file",
        )
    return max(kept, key=_number)


def _kept(campaign: "Campaign") -> list[Path]:
    return list(campaign.folder.glob(KEPT.format(number="*")))


def _number(path: Path) -> int:
    digits = path.stem.rpartition("-")[2]
    return int(digits) if digits.isdecimal() else 0


def show(terminal: "Terminal", found: "tuple[Change, ...]") -> None:
    """The parameters that would change."""
    rows = [
        (
            change.name,
            f"{change.old:.4f}",
            f"{change.new:.4f}",
            f"{change.delta:+.4f}",
            "-" if change.in_sigmas is None else f"{change.in_sigmas:+.0f}",
        )
        for change in found
        if change.delta != 0.0
    ]
    terminal.table("Controller (mm, deg)", ("", "holds", "will hold", "Δ", "Δ/σ"), rows)
