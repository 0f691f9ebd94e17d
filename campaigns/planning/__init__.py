"""Plans: poses to measure, their order, safe ways between them, and the uncertainty to expect."""
