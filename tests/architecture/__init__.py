"""Tests of the map of the rooms."""
