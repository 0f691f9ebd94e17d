"""Laser trackers that speak emScon."""
