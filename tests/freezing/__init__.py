"""Frozen stores in Python."""
