"""Prometheus metrics and health of the daemon and its worker processes."""
