"""Builds the network and the score that ship: composites of real and made ore, a small net, a head for boxes.

Needs the development dependencies and pictures that are not part of the repository; see docs/model-card.md.
"""
