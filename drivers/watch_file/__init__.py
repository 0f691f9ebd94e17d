"""Trackers whose own software writes points into a file."""
