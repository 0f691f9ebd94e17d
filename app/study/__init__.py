"""Monte Carlo studies: from a campaign's files to tasks, and tasks to workers."""
