"""Trajectories and pose graphs: their text files, and stamps of the same moment."""
