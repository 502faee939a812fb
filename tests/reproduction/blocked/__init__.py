"""Blocked mouths: how soon they are announced, and what else is, beside two simple peers."""
