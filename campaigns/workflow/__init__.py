"""The workflow: plan, run, validate, identify, export and load a campaign."""
