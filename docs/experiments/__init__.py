"""The experiments of the papers as configurations and commands."""
