"""One whole campaign for all tests that only read it."""

from whole_campaigns import by_distances, whole

__all__ = ["by_distances", "whole"]
