"""Measured shots, whoever measured them: as arrays, and in and out of files."""
