"""Scenarios: what a simulated cell is made of, as files."""
