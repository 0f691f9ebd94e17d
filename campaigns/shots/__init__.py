"""Measured shots of any origin: as arrays, and in and out of files."""
