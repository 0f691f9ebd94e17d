"""Monte Carlo over simulated campaigns."""
