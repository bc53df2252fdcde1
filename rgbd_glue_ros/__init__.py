"""Live RGB-D odometry by RGBD-Glue: visual correspondences guide geometric ones."""
