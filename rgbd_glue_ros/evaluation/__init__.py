"""Errors of trajectories and registrations against ground truth."""
