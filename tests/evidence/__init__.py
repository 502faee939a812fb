"""Evidence of alarms."""
