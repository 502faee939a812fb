"""Tests of the hub's process."""
