"""Laws of the geometry, on random poses, through the Python API."""
