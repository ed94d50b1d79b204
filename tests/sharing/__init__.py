"""Shared stores in Python."""
