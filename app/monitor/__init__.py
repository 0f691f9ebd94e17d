"""Live page of a campaign, served by a process of its own: a fault of the page stops no run."""
