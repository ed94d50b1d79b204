"""Files for the viewers Rerun and Foxglove."""
