"""Calibration of parallel robots with a laser tracker: the work, and its Python API.

What is named here is loaded when it is used, so that the command line starts quickly.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from campaigns import workflow
    from campaigns.api import (
        correct_targets,
        find_robot,
        identify,
        plan,
        point_residuals,
        read_shots,
        sample_workspace,
        study,
    )
    from campaigns.campaign import open_campaign
    from campaigns.estimation.tracker_noise import TrackerUncertainty
    from campaigns.evidence import evaluate
    from campaigns.mechanisms.mechanism import Kinematics
    from campaigns.shots.shots import Shots

HOMES = {
    "NewOptions": "app.new_campaign",
    "Kinematics": "campaigns.mechanisms.mechanism",
    "Shots": "campaigns.shots.shots",
    "TrackerUncertainty": "campaigns.estimation.tracker_noise",
    "connected_cell": "app.wiring",  # both devices of a campaign: only the wiring knows drivers
    "create_campaign": "app.new_campaign",
    "create_simulated": "app.new_campaign",
    "evaluate": "campaigns.evidence",
    "open_campaign": "campaigns.campaign",
    "prepare": "app.wiring",
}
"""Modules of what is not in `campaigns.api`, by name."""

__all__ = [
    "Kinematics",
    "NewOptions",
    "Shots",
    "TrackerUncertainty",
    "connected_cell",
    "correct_targets",
    "create_campaign",
    "create_simulated",
    "evaluate",
    "find_robot",
    "identify",
    "open_campaign",
    "plan",
    "point_residuals",
    "prepare",
    "read_shots",
    "sample_workspace",
    "study",
    "workflow",
]


def __getattr__(name: str) -> object:
    """Class, function or module of that name."""
    if name not in __all__:
        raise AttributeError(
            f"module {__name__!r} has no attribute {name!r}; it has {', '.join(__all__)}"
        )
    if name == "workflow":
        return import_module("campaigns.workflow")
    return getattr(import_module(HOMES.get(name, "campaigns.api")), name)


def __dir__() -> list[str]:
    """Names that a prompt completes."""
    return __all__
