"""The run engine: moves, measures, watches, resumes."""
