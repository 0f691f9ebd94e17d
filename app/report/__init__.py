"""What people read of a campaign: page, tables and pictures."""

import logging

# Where the home cannot be written, Matplotlib takes a temporary folder for its cache, removes it at
# the end and warns of both: nothing that a user of a report could or should change.
logging.getLogger("matplotlib").setLevel(logging.ERROR)
