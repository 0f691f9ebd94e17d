"""The journal: records, the database that keeps them, and what it says."""
