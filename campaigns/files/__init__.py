"""How any file is read and written, and how what is wrong with it is said."""
