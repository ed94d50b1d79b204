"""The history checker, checked."""
