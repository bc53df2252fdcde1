"""From odometry to a map: place recognition, loop verification, pose graph optimisation."""
