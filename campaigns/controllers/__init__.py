"""The parameter file, and what takes it into a controller."""
