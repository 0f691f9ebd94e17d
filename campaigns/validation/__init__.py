"""Whether the robot is good: the paper's tests, ISO 9283, limits."""
