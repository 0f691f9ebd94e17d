"""Loading of a parameter file into the controller."""

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

from campaigns.campaign import Campaign
from campaigns.controllers import export as parameter_file
from campaigns.controllers.load import Change, changes, differing, keep, write_verified
from campaigns.journal.records import Finding
from campaigns.robots.robot import read_robot
from drivers.ports import RobotController


def load(
    campaign: Campaign,
    connection: AbstractContextManager[RobotController],
    source: Path | None = None,
    *,
    approve: Callable[[tuple[Change, ...]], bool] = lambda _: True,
    uninterrupted: AbstractContextManager[object] | None = None,
) -> Path | None:
    """Load a robot file, the exported one by default; gives where the old parameters are kept.

    `connection` is made once the file is known to be one for controllers. None when nothing was
    done. `approve` is shown the changes and says whether to go on;
    `uninterrupted` holds signals off while parameters are written. Raises `ConfigInvalid` for
    parameters that no controller knows.
    """
    source = source or campaign.path(parameter_file.FILE_NAME)
    robot = read_robot(source).robot
    wanted = robot.controller_flat()
    with campaign.journal() as journal, connection as controller:
        old = dict(controller.read_geometry())
        if not differing(old, wanted) or not approve(changes(old, robot)):
            return None
        with uninterrupted or nullcontext():
            kept = keep(campaign.folder, campaign.nominal, old)
            write_verified(controller, wanted, old)
            body = {"source": source.name, "digest": robot.digest(), "kept": kept.name}
            journal.append(Finding("load", body))
    return kept
