"""The report of a shift."""
