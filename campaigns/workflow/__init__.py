"""The workflow: plan, run, validate, identify, export and load a campaign, each giving its result.

Each step is loaded when it is asked for.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from campaigns.workflow.files import export, export_hal, export_shots
    from campaigns.workflow.identification import identify
    from campaigns.workflow.importing import import_shots, import_validation
    from campaigns.workflow.loading import load
    from campaigns.workflow.planning import plan
    from campaigns.workflow.running import run
    from campaigns.workflow.validation import validate

_HOMES = {
    "export": "files",
    "export_hal": "files",
    "export_shots": "files",
    "identify": "identification",
    "import_shots": "importing",
    "import_validation": "importing",
    "load": "loading",
    "plan": "planning",
    "run": "running",
    "validate": "validation",
}

__all__ = [
    "export",
    "export_hal",
    "export_shots",
    "identify",
    "import_shots",
    "import_validation",
    "load",
    "plan",
    "run",
    "validate",
]


def __getattr__(name: str) -> object:
    """Step of that name."""
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module(f"{__name__}.{_HOMES[name]}"), name)
