"""Plans: poses to measure, their order and ways, and the uncertainty a plan will give."""
