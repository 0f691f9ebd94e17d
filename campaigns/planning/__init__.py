"""Plans: poses to measure, their order and ways, and the precision a plan will give."""
