"""Bouncing square."""
