"""Fit of a robot to measured points: one model in which every source of error has a prior."""
