"""A furnished room, ray cast: exact depth and colour, and what an RGB-D camera makes of it."""
