"""Shows a run in the Rerun viewer: everything in one place, over time."""
