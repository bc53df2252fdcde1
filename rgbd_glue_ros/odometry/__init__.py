"""The pose of a moving camera, from keyframes, tracking and relocalisation."""
