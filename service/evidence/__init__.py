"""Evidence of an alarm: clip, still, curve and filter state, kept for people and for an exact replay."""
