"""Tests of the numerics against oracles, hand-worked values and properties."""
