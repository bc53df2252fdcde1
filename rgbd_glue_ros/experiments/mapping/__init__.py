"""A recording made into a map: odometry, loops, corrected trajectory, cloud."""
