"""The map of the rooms, enforced."""
