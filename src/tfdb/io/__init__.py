"""Files in and out: recordings, trajectories, robot models."""
