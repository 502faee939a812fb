"""Proof tests: a synthetic lump in real frames must come out as an alarm, through the whole chain."""
