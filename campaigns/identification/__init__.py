"""Identification: a robot's parameters from measured shots, with uncertainty and a verdict."""
