"""Wire grammar without I/O: bytes to messages and back, for drivers and simulated servers alike."""
