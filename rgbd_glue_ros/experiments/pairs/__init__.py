"""The registration of pairs of frames, as in the tables of the paper."""
