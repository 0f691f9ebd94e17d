"""Steps of a campaign, for Python: each does the work of the command of its name.

Example of a whole campaign on a connected cell (docs/reference/python.md has it to run):

    workflow.plan(campaign)
    with connected_cell(campaign) as cell:
        prepare(campaign, cell)
        workflow.validate(campaign, cell, ValidationOptions(stage="before"))
        workflow.run(campaign, cell)
    workflow.identify(campaign)
    workflow.export(campaign)
    with connected_cell(campaign) as cell:
        prepare(campaign, cell)
        workflow.load(campaign, nullcontext(cell))
        workflow.validate(campaign, cell, ValidationOptions(stage="after"))
"""

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
