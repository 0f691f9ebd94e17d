"""Controllers that speak robotline."""
