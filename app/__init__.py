"""The door: commands, wiring of real or simulated devices, the terminal."""
