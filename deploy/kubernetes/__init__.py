"""Kubernetes objects; only the maker of the rules is Python."""
