"""Frozen stores, as Python sees them."""
