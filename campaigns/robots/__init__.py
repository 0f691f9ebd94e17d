"""Parameter sets: robot files, the robots shipped, and what the numerics make of them."""
