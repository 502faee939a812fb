"""The report of a shift: figures from the event log, as JSON and as a page."""
