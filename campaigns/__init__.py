"""Calibration of parallel robots with a laser tracker: the work, and its Python API.

What is named here is loaded when it is used, so that the command line starts quickly.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from campaigns.api import correct_targets, find_robot, identify, plan, read_shots, study
    from campaigns.campaign import open_campaign
    from campaigns.evidence import evaluate

__all__ = [
    "correct_targets",
    "evaluate",
    "find_robot",
    "identify",
    "open_campaign",
    "plan",
    "read_shots",
    "study",
]


def __getattr__(name: str) -> object:
    """Function of that name."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    homes = {"open_campaign": "campaigns.campaign", "evaluate": "campaigns.evidence"}
    return getattr(import_module(homes.get(name, "campaigns.api")), name)
