"""Measures of whether a picture is fit to judge: sharp, lit, alive, unobstructed, and where it was."""
