"""Measurements and demonstrations; a robot does not need this folder."""
