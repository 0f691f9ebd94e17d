"""One command a file: what Typer shows above, the work below. Heavy libraries are imported inside."""
