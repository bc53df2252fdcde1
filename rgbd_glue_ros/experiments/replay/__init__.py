"""The odometry over a recording, with its errors and its report."""
