"""Pages and charts that experiments write."""
