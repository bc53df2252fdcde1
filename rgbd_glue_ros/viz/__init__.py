"""What a run looks like in the Rerun viewer: everything in one place, over time."""
