"""Where to measure, in which order, by which ways; and what a plan will tell."""
