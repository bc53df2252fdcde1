"""What the nodes need and no ROS: monitor, worker, extrinsics, and faults in words."""
