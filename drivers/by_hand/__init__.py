"""Devices whose part a person takes: what to do is shown, what a display shows is typed."""
