"""What the node needs and ROS does not: monitoring, worker, frames, input faults."""
