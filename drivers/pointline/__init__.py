"""Instruments that speak pointline."""
