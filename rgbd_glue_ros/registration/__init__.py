"""The transform between two RGB-D frames, by the method of RGBD-Glue."""
