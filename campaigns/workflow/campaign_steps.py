"""Steps of a campaign for Python: each does what the command of its name does."""

from campaigns.workflow.exporting import export, export_hal, export_shots
from campaigns.workflow.identification import identify
from campaigns.workflow.importing import import_shots, import_validation
from campaigns.workflow.loading import load
from campaigns.workflow.planning import plan
from campaigns.workflow.running import run
from campaigns.workflow.validation import validate

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
