"""Wire grammar without any I/O: bytes in, messages out, and back. Clients and simulated servers share it."""
