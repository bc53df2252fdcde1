"""Estimators of the paper's related work that need no training, written from their publications."""
