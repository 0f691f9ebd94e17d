"""One command a file: what Typer shows above, the work below; heavy imports are inside."""
