"""Stores that processes share, as Python sees them."""
