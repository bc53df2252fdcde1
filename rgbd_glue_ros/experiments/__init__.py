"""Measurements and demonstrations; without this folder the robot still drives."""
