"""Calibration of parallel robots with a laser tracker: the work. Its Python API is `pkmcal`."""
