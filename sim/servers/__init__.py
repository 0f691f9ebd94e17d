"""The wires of the simulated cell: servers that speak what real devices speak."""
