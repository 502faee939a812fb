"""Experiments and fitted defaults, each made by one command from generated or real footage."""
