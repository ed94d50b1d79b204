"""Isolation, one anomaly at a time, in every engine."""
