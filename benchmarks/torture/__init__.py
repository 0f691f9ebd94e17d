"""Long forms of the tests by garbage, kills and faults: each prints figures."""
