"""Files of any kind: reading, writing, and saying what is wrong with them."""
