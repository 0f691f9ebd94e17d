"""The instruments: wire grammar, transports, links, robot controllers and laser trackers."""
