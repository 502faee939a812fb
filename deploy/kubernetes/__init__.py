"""Kubernetes objects; only what makes rules and sites is Python."""
