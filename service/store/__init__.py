"""What the daemon keeps: atomic, checksummed, versioned."""
