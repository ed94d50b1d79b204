"""Many threads on one store."""
