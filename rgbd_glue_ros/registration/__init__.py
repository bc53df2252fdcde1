"""The transform between two RGB-D frames, by the RGBD-Glue method."""
