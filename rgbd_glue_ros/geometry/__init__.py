"""Rigid motions, cameras and point clouds: the mathematics that everything else uses."""
