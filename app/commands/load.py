"""pkmcal load: the compensated parameters into the controller."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from app.options import Dry, Folder, Json, Yes

if TYPE_CHECKING:
    from collections.abc import Mapping

    from app.console import Terminal
    from app.folder import Campaign
    from campaigns.load import Change

KEPT = "controller-before-{number}.yaml"


def command(
    folder: Folder,
    *,
    file: Annotated[
        Path | None, typer.Option(help="Another robot file than DIR/robot-compensated.yaml.")
    ] = None,
    rollback: Annotated[
        bool, typer.Option("--rollback", help="Put back what the last load replaced.")
    ] = False,
    dry: Dry = False,
    yes: Yes = False,
    json: Json = False,
) -> None:
    """Load parameters into the controller: read back what it holds, keep that as a file, show the
    difference, ask, write, read back and verify.

    What does not verify is taken back. The robot must stand still.
    """
    from app.console import Terminal
    from app.folder import open_campaign
    from campaigns.export import FILE_NAME

    terminal = Terminal(as_json=json)
    campaign = open_campaign(folder)
    source = last_kept(campaign) if rollback else file or campaign.path(FILE_NAME)
    kept = load(campaign, source, terminal, dry=dry, yes=yes)
    terminal.document(
        {"loaded": None if dry else str(source), "kept": None if kept is None else str(kept)}
    )


def load(
    campaign: "Campaign",
    source: Path,
    terminal: "Terminal",
    *,
    dry: bool = False,
    yes: bool = False,
) -> Path | None:
    """Load a robot file; gives where the old parameters are kept, None when nothing was done."""
    from app.folder import journal_of
    from app.wiring import connected_robot
    from campaigns.load import changes, differing, write_verified
    from campaigns.records import Finding
    from campaigns.robot import read_robot

    robot = read_robot(source).robot
    with journal_of(campaign) as journal, connected_robot(campaign) as controller:
        old = dict(controller.read_geometry())
        show(terminal, changes(old, robot))
        if not differing(old, robot.geometry_flat()):
            terminal.say("the controller holds these parameters already")
            return None
        if dry:
            terminal.say("nothing was written")
            return None
        if not yes and not terminal.confirm("Write these parameters? The robot must stand still."):
            raise typer.BadParameter("not confirmed: answer y, or give --yes")
        kept = keep(campaign, old)
        write_verified(controller, robot.geometry_flat(), old)
        body = {"source": source.name, "digest": robot.digest(), "kept": kept.name}
        journal.append(Finding("load", body))
    terminal.say(f"loaded and verified: {source.name}; the old parameters: {kept.name}", "green")
    return kept


def keep(campaign: "Campaign", old: "Mapping[str, float]") -> Path:
    """Write what the controller holds as a robot file under the next free number."""
    from campaigns.robot import Compensation, compensated, write_new_robot

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
        raise ShotsMissing("nothing was loaded here yet", remedy="there is nothing to roll back")
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
