"""Live page of a campaign: reads its journal from a process of its own, never part of a run."""
