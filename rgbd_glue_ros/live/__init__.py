"""The parts of the nodes that do not need ROS: monitor, worker, extrinsics, fault messages."""
