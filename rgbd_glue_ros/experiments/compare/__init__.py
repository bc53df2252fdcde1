"""What differs between replays of a recording: their figures, parameters and trajectories."""
