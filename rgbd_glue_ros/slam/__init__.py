"""From odometry to a map: places recognised, loops verified, the pose graph at its optimum."""
